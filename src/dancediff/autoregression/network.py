r"""What training, dancing and model folders ask of a network that makes a dance bit by bit.

Symbols (axes: b batch · n dancers · f frames · s frames before the first · d motion, m music
         features)
    x         motion, normalised                         (b, f, d)
    history   the frames before the dance, normalised    (n, s, d)
    M         music features, standardised               (b, f, m), of a song (f, m)
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from dancediff.data.windows import Batch
from dancediff.motion.representation import TCDIFFPP
from dancediff.nn.dance_network import NormalizedNetwork


class AutoregressiveNetwork(NormalizedNetwork, ABC):
    """A network for one dancer, or, where ``solo`` is false, for a group that it dances together.

    A group of solos is dancers who know nothing of each other.

    ``stages``: the trainings that it needs, one after the other.
    ``standing``: a frame of somebody who stands, in metres (d,): the mean of the training set.
    """

    solo: ClassVar[bool] = True
    stages: ClassVar[tuple[str, ...]]
    standing: Tensor

    def __init__(self, motion_dim: int, music_dim: int):
        super().__init__(motion_dim, music_dim)
        self.register_buffer("standing", torch.zeros(motion_dim))

    @abstractmethod
    def losses(self, batch: Batch, stage: str, generator: torch.Generator) -> dict[str, Tensor]:
        """Terms of a stage's loss by name and their sum "total".

        ``batch``: motion (b, n, f, d) and music in the network's units.
        """

    @abstractmethod
    def dance(
        self, history: Tensor, M: Tensor, request: Any, generators: Sequence[torch.Generator]
    ) -> Iterator[Tensor]:
        """Pieces of a dance (n, k, d) to a song, normalised, at least ``request.frames`` together.

        ``request``: how it is asked for, resolved.  ``generators``: one for each dancer.
        """

    @property
    @abstractmethod
    def history_frames(self) -> int:
        """How many frames before the first one the network sees."""

    def learning(self, stage: str) -> Sequence[nn.Module]:
        """The parts whose weights a stage changes; by default all."""
        return [self]


def check_targets(config: Any) -> None:
    """Refuse to guess more frames than there are motion tokens to read them from.

    Raises: ValueError naming ``targets``.
    """
    if config.targets > config.seed_frames:
        raise ValueError(
            f"targets={config.targets} is more than seed_frames={config.seed_frames}, whose tokens "
            "are read; choose fewer"
        )


def check_seen(history: Tensor, M: Tensor, config: Any) -> None:
    """Refuse motion (b, s, d) and music (b, w, m) that are not what a network sees at once.

    Raises: ValueError naming the argument whose shape does not fit.
    """
    for name, value, shape in (
        ("history", history, (config.seed_frames, config.motion_dim)),
        ("M", M, (config.music_frames, config.music_dim)),
    ):
        if value.ndim != 3 or value.shape[1:] != shape:
            raise ValueError(f"{name} has shape {tuple(value.shape)}; expected (b, *{shape})")


def moved_to_origin(x: Tensor, at: int) -> Tensor:
    """Places on the floor seen from where the dancer is at frame ``at``; a copy.

    What a network learns from then does not depend on where on the stage somebody dances.

    Shapes: x (..., f, d) normalised -> the same.

    >>> x = torch.ones(1, 3, 151) * torch.arange(3.0)[:, None]
    >>> moved_to_origin(x, at=1)[0, :, 3:7].tolist()[2]
    [2.0, 1.0, 2.0, 1.0]
    """
    y = x.clone()
    y[..., TCDIFFPP.floor] -= x[..., at : at + 1 if at != -1 else None, TCDIFFPP.floor]
    return y
