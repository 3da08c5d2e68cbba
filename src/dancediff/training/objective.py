r"""What a training minimises: noise a batch, let the model guess the clean motion, compare.

Read first: notebook 05. Everything random follows from the seed and the number of the batch.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    x_0, x_t   clean and noisy motion, normalised      (b, n, f, d)
    t          noise level of each row                 (b,)
    mask       False: the music is dropped             (b,)
    weight     of a row in the losses                  (b,)
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, is_dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Generic, TypeVar, cast

import torch
from torch import Tensor

from dancediff.data.windows import Batch
from dancediff.diffusion.conditions import Conditions, Denoiser
from dancediff.diffusion.schedule import noise_like, q_sample, send
from dancediff.extensions.energy_condition import has_energy_condition, with_dropped_energy
from dancediff.extensions.genre_condition import genre_condition_of, with_dropped_genre
from dancediff.extensions.level_weights import draw_levels, weights_of
from dancediff.extensions.music_dropout import with_dropped_blocks
from dancediff.extensions.own_overlap import OverlapDraw, draw_overlap, with_own_overlap
from dancediff.nn.dance_network import DanceNetwork, NormalizedNetwork
from dancediff.nn.losses import Comparison, compare
from dancediff.nn.precision import fastest_dtype
from dancediff.papers.tcdiffpp.losses import LossWeights, five_losses
from dancediff.training.config import TrainConfig
from dancediff.training.extended_losses import extended_losses

Network = TypeVar("Network", bound=NormalizedNetwork)


@dataclass(frozen=True)
class Noised:
    """A batch with noise, and the generator for what else is random about it."""

    x_t: Tensor
    t: Tensor
    mask: Tensor
    weight: Tensor | None
    generator: torch.Generator


@dataclass(frozen=True)
class Drawn:
    """A batch on the network's device, and all that is random about it."""

    batch: Batch
    noised: Noised
    conditions: Conditions
    z: Tensor | None = None  # noise of Lodge's style (b, z)

    overlap: OverlapDraw | None = None  # windows that begin as the network makes them

    def tensors(self) -> list[Tensor]:
        """All that the losses follow from, besides the weights."""
        return [part for part in _leaves(self) if isinstance(part, Tensor)]

    def clone(self) -> "Drawn":
        """The same with tensors of its own."""
        return _cloned(self)


def _leaves(value) -> Iterator[Any]:
    """What is in a dataclass, and in those in it, in a fixed order."""
    if isinstance(value, Batch):
        yield from value
    elif is_dataclass(value):
        for name in vars(value):
            yield from _leaves(getattr(value, name))
    else:
        yield value


def _cloned(value) -> Any:
    """The same with tensors of its own."""
    if isinstance(value, Tensor):
        return value.clone()
    if isinstance(value, Batch):
        parts: Any = map(_cloned, value)
        return Batch(*parts)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{name: _cloned(part) for name, part in vars(value).items()})
    return value


class BatchLosses(ABC, Generic[Network]):
    """The losses of a batch; a subclass says which, in `losses`."""

    def __init__(self, model: Network, config: TrainConfig):
        self.model, self.config = model, config

    @abstractmethod
    def losses(self, model: Network, batch, number: int) -> dict[str, Tensor]:
        """All terms of a batch by name, and their weighted sum "total"."""

    def state(self) -> dict[str, Tensor]:
        """What a checkpoint must hold besides model and optimiser."""
        return {}

    @property
    def device(self) -> torch.device:
        """Where the network computes."""
        return self.model.normalizer.low.device

    def to_network(self, batch) -> Batch:
        """A batch on the network's device, its motion and music in the network's units."""
        model = self.model
        there = Batch(*batch).to(self.device)
        x, M = model.normalizer.normalize(there.x), model.music_normalizer.normalize(there.M)
        return there._replace(x=x, M=M)

    @contextmanager
    def same_dropout(self, number: int):
        """Inside, dropout follows from the batch's number."""
        device = self.device
        with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
            torch.manual_seed(self.seed(number))  # dropout has no generator argument
            yield

    def autocast(self) -> torch.autocast:
        """Inside, networks compute in the precision of the config."""
        kind, precision = self.device.type, self.config.precision
        half = precision == "bf16" or (
            precision == "fastest" and fastest_dtype(kind) == torch.bfloat16
        )
        return torch.autocast(kind, torch.bfloat16, enabled=half)

    def seed(self, number: int) -> int:
        """Of what is random about a batch."""
        return self.config.seed * 1_000_003 + number


class Objective(BatchLosses[DanceNetwork]):
    """Losses of a guess of the clean motion, which is made from a noisy one.

    First everything random is drawn, then the losses follow from it and the weights alone.
    """

    @property
    def draws_first(self) -> bool:
        """Does `compared` draw nothing itself?"""
        return True

    @abstractmethod
    def drawn(self, model: Any, batch, number: int) -> Drawn:
        """A `Batch` on the network's device, with noise."""

    @abstractmethod
    def compared(self, model: Any, drawn: Drawn) -> dict[str, Tensor]:
        """All terms of the network's guess by name, and their weighted sum "total"."""

    def losses(self, model: Any, batch, number: int) -> dict[str, Tensor]:
        """All terms of a `Batch` by name, and their weighted sum "total"."""
        drawn = self.drawn(model, batch, number)
        with self.same_dropout(number):
            return self.compared(model, drawn)

    @cached_property
    def level_weights(self) -> Tensor | None:
        """See `dancediff.extensions.level_weights`."""
        return weights_of(self.model, self.config.extensions.level_weights)

    def conditions(self, batch: Batch, noised: Noised, **own: Tensor | None) -> Conditions:
        """What the network is given beside the motion; ``own``: swap or style.

        Genre and energy, of networks with parts for them, are left out of some rows each for
        itself; where the music is dropped, those parts leave them out as well.
        """
        genre = energy = None
        if self.has_genre and batch.genre is not None:
            genre = with_dropped_genre(batch.genre, noised.generator)
        if self.has_energy and batch.energy is not None:
            energy = with_dropped_energy(batch.energy, noised.generator)
        M, share = batch.M, self.config.extensions.music_dropout
        if share:
            M = with_dropped_blocks(M, share, noised.generator)
        return Conditions(M, music_mask=noised.mask, genre=genre, energy=energy, **own)

    @cached_property
    def has_genre(self) -> bool:
        """Does the network have a part for the genre?"""
        return genre_condition_of(self.model) is not None

    @cached_property
    def has_energy(self) -> bool:
        """Does the network have a part for the energy of music?"""
        return has_energy_condition(self.model)

    def noised(self, x_0: Tensor, number: int) -> Noised:
        """Draw a noise level for every row, the noise, and whose music is dropped."""
        b, device, sizes = len(x_0), x_0.device, self.model.config
        g = torch.Generator().manual_seed(self.seed(number))  # CPU: the same on every device
        if self.level_weights is None:
            t, weight = torch.randint(sizes.num_steps, (b,), generator=g), None
        else:
            t, weight = draw_levels(self.level_weights, b, g)
            weight = send(weight, device)
        t = send(t, device)
        eps = noise_like(x_0, g)
        mask = send(torch.rand(b, generator=g) >= sizes.cond_drop, device)
        x_t = q_sample(x_0, t, self.model.abar, eps).to(x_0.dtype)
        return Noised(x_t, t, mask, weight, g)


class GroupObjective(Objective):
    """Eq. 18 of TCDiff++, for `TCDiffPP` and `EDGE`; other networks of groups override `terms`."""

    weights: ClassVar[type] = LossWeights  # of its terms, the table [weights] of a config

    def terms(self, c: Comparison) -> dict[str, Tensor]:
        """The terms that compare a guess with the truth."""
        return five_losses(c)

    def extra_terms(self, model: Any, batch: Batch, noised: Noised, c: Conditions) -> dict:
        """Terms that need more than a guess and the truth; here none."""
        return {}

    def drawn(self, model: Any, batch, number: int) -> Drawn:
        """A `Batch` on the network's device, with noise."""
        batch = self.to_network(batch)
        noised = self.noised(batch.x, number)
        conditions = self.conditions(batch, noised, swap=batch.label)
        share = self.config.extensions.own_overlap
        overlap = draw_overlap(batch.x, share, self.model.config.num_steps, noised.generator)
        return Drawn(batch, noised, conditions, overlap=overlap)

    def compared(self, model: Any, drawn: Drawn) -> dict[str, Tensor]:
        """All terms of the network's guess by name, and their weighted sum "total"."""
        batch, noised, conditions = drawn.batch, drawn.noised, drawn.conditions
        x_t = self._with_own_overlap(model, drawn)
        with self.autocast():
            guess = model(x_t, noised.t, conditions)
            own = self.extra_terms(model, batch, noised, conditions)
        x_raw, x_hat = guess if isinstance(guess, tuple) else (guess, guess)  # EDGE adapts nothing
        return extended_losses(
            compare(x_raw.float(), x_hat.float(), batch.x, model.normalizer),
            lambda c: self.terms(c) | own,
            self.config.weights.terms(),
            extensions=self.config.extensions,
            reconstruction="simple",
            row_weights=noised.weight,
        )

    def _with_own_overlap(self, model: DanceNetwork, drawn: Drawn) -> Tensor:
        """x_t of windows some of which begin as the network makes them, under the same noise."""
        x_0, noised = drawn.batch.x, drawn.noised
        if drawn.overlap is None:
            return noised.x_t
        with self.autocast():
            mixed = with_own_overlap(cast(Denoiser, model), x_0, drawn.conditions, drawn.overlap)
        signal = model.abar[noised.t].sqrt().reshape(-1, *[1] * (x_0.ndim - 1))
        return (noised.x_t + signal * (mixed - x_0)).to(noised.x_t.dtype)
