r"""What a training minimises: noise a batch, let the model guess the clean motion, compare.

Read first: notebook 05. Everything random follows from the seed and the number of the batch.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    x_0, x_t   clean and noisy motion, normalised      (b, n, f, d)
    t          noise level of each row                 (b,)
    mask       False: the music is dropped             (b,)
    weight     of a row in the losses                  (b,)
"""

from abc import ABC, abstractmethod
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Generic, TypeVar, cast

import torch
from torch import Tensor

from dancediff.data.windows import Batch
from dancediff.diffusion.conditions import Conditions, Denoiser
from dancediff.diffusion.schedule import q_sample
from dancediff.extensions.energy_condition import listens_to_energy, with_dropped_energy
from dancediff.extensions.genre_condition import genre_condition_of, with_dropped_genre
from dancediff.extensions.level_weights import draw_levels, weights_of
from dancediff.extensions.music_dropout import with_dropped_blocks
from dancediff.extensions.own_overlap import with_own_overlap
from dancediff.nn.dance_network import DanceNetwork, NormalizedNetwork
from dancediff.nn.losses import Comparison, compare
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
    def deterministic_autocast(self, number: int):
        """Inside, dropout follows from the batch's number, in the precision of the config."""
        device = self.device
        half = self.config.precision == "bf16"
        with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
            torch.manual_seed(self.seed(number))  # dropout has no generator argument
            with torch.autocast(device.type, torch.bfloat16, enabled=half):
                yield

    def seed(self, number: int) -> int:
        """Of what is random about a batch."""
        return self.config.seed * 1_000_003 + number


class Objective(BatchLosses[DanceNetwork]):
    """Losses of a guess of the clean motion, which is made from a noisy one."""

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
        return listens_to_energy(self.model)

    def noised(self, x_0: Tensor, number: int) -> Noised:
        """Draw a noise level for every row, the noise, and whose music is dropped."""
        b, device, sizes = len(x_0), x_0.device, self.model.config
        g = torch.Generator().manual_seed(self.seed(number))  # CPU: the same on every device
        if self.level_weights is None:
            t, weight = torch.randint(sizes.num_steps, (b,), generator=g), None
        else:
            t, weight = draw_levels(self.level_weights, b, g)
            weight = weight.to(device)
        t = t.to(device)
        eps = torch.randn(x_0.shape, generator=g).to(device)
        mask = (torch.rand(b, generator=g) >= sizes.cond_drop).to(device)
        x_t = q_sample(x_0, t, self.model.abar, eps).to(x_0.dtype)
        return Noised(x_t, t, mask, weight, g)


class GroupObjective(Objective):
    """Eq. 18 of TCDiff++, for `TCDiffPP` and `EDGE`; other networks of groups override `terms`."""

    weights: ClassVar[type] = LossWeights  # of its terms, the table [weights] of a config

    def terms(self, c: Comparison) -> dict[str, Tensor]:
        """The terms that compare a guess with the truth."""
        return five_losses(c)

    def own_terms(self, model: Any, batch: Batch, noised: Noised, c: Conditions) -> dict:
        """Terms that need more than a guess and the truth; here none."""
        return {}

    def losses(self, model: DanceNetwork, batch, number: int) -> dict[str, Tensor]:
        """All terms of a `Batch` by name, and their weighted sum "total"."""
        batch = self.to_network(batch)
        x_0, noised = batch.x, self.noised(batch.x, number)
        conditions = self.conditions(batch, noised, swap=batch.label)
        with self.deterministic_autocast(number):
            x_t = self._with_own_overlap(model, x_0, noised, conditions)
            guess = model(x_t, noised.t, conditions)
            own = self.own_terms(model, batch, noised, conditions)
        x_raw, x_hat = guess if isinstance(guess, tuple) else (guess, guess)  # EDGE adapts nothing
        return extended_losses(
            compare(x_raw.float(), x_hat.float(), x_0, model.normalizer),
            lambda c: self.terms(c) | own,
            self.config.weights.terms(),
            extensions=self.config.extensions,
            reconstruction="simple",
            row_weights=noised.weight,
        )

    def _with_own_overlap(
        self, model: DanceNetwork, x_0: Tensor, noised: Noised, conditions: Conditions
    ) -> Tensor:
        """x_t of windows some of which begin as the network makes them, under the same noise."""
        share = self.config.extensions.own_overlap
        if not share:
            return noised.x_t
        changed = (
            with_own_overlap(cast(Denoiser, model), x_0, conditions, share, noised.generator) - x_0
        )
        signal = model.abar[noised.t].sqrt().reshape(-1, *[1] * (x_0.ndim - 1))
        return (noised.x_t + signal * changed).to(noised.x_t.dtype)
