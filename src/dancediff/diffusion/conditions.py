r"""Conditions: the inputs of a denoiser besides the noisy motion and its step.

Symbols (axes: b batch · n dancers · f frames · m music features · g genres)
    music       M, standardised music features           (b, f, m)
    swap        S, swap mode of TCDiff++                 (b, n)
    style       style token of Lodge                     (b, d_model)
    music_mask  False: the null music of classifier-free guidance   (b,)
    genre       shares of a mix of genres, at least 0; what they lack to 1 is no genre   (b, g)
    energy      how full the music is, 0 to 1; nan where that is unknown                 (b, f)
    latent      z, what a network of groups draws for a whole dance                      (b, z)
    path        where everybody goes, normalised x and z on the floor               (b, n, f, 2)
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import torch
from torch import Tensor


@dataclass(frozen=True)
class Conditions:
    """Each model reads the fields it knows; the others stay None.

    >>> conditions = Conditions(torch.zeros(2, 150, 35), swap=torch.tensor([[0, 1], [1, 0]]))
    >>> len(conditions), len(conditions.repeat(3))
    (2, 6)
    """

    music: Tensor
    swap: Tensor | None = None
    style: Tensor | None = None
    music_mask: Tensor = None  # type: ignore[assignment] # None becomes all True
    genre: Tensor | None = None
    energy: Tensor | None = None
    latent: Tensor | None = None
    path: Tensor | None = None

    def __post_init__(self):
        """Without a mask all rows have music."""
        if self.music_mask is None:
            everybody = torch.ones(len(self.music), dtype=torch.bool, device=self.music.device)
            object.__setattr__(self, "music_mask", everybody)

    def __len__(self) -> int:
        """Rows of the batch."""
        return len(self.music)

    def repeat(self, copies: int) -> "Conditions":
        """The whole batch ``copies`` times, one after the other."""
        return self if copies == 1 else self._each(lambda value: torch.cat([value] * copies))

    def each_row(self, times: int) -> "Conditions":
        """Every row ``times`` times before the next one.

        >>> Conditions(torch.arange(2.0)[:, None, None]).each_row(2).music.flatten().tolist()
        [0.0, 0.0, 1.0, 1.0]
        """
        # the same tensors again where nothing is repeated: by their place in memory music is kept
        return self if times == 1 else self._each(lambda value: value.repeat_interleave(times, 0))

    def rows(self, which: slice | Tensor) -> "Conditions":
        """Some rows of the batch."""
        return self._each(lambda value: value[which])

    def _each(self, change: Callable[[Tensor], Tensor]) -> "Conditions":
        given = {name: value for name, value in vars(self).items() if value is not None}
        return replace(self, **{name: change(value) for name, value in given.items()})

    def with_mask(self, music_mask: Tensor) -> "Conditions":
        """The same conditions under another mask (b,)."""
        return replace(self, music_mask=music_mask)


class Denoiser(Protocol):
    """What sampling, training and evaluation ask of a model; ``abar``: signal left, by step."""

    abar: Tensor

    def denoise(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """The guess of the clean motion; x_t (b, ..., f, d), t (b,) -> like x_t."""
        ...
