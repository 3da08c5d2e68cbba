r"""Spots on the floor at which Lodge's local segments begin and end: a hook on its guesses.

Read first: notebook 12 · `dancediff.extensions.constraint`.

Hard cues do not say where on the floor a dancer is, so each segment travels as it likes, and many
of them add up to a walk off the stage. A spot is drawn for each border of two segments; since every
segment knows both of its own, all can still be made in parallel.

Symbols (axes: l local segments · f frames · d motion features)
    spots    x and z of the spot at each border, metres    (l + 1, 2)
    std      standard deviation of each frequency          (k, d)
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from dancediff.extensions.constraint import Constraint
from dancediff.motion.representation import LODGE, Normalizer
from dancediff.papers.lodge.parallel import SOFT_CUES, row_generators

SPREAD = 0.4  # metres: neighbouring spots are as far apart as the choreographer goes in 8.5 s
SPOTS = SOFT_CUES + 1  # what noise is for, beside that of the sampler


def stage_spots(seed: int, rows: int, first: int = 0) -> Tensor:
    r"""The spots of local segments from number ``first`` on: where each begins, and the last ends.

    $$p_0 = 0, \qquad p_k \sim \mathcal N(0, \sigma^2 I), \quad \sigma = 0.4\text{ m}$$

    Source: ours; Lodge lets dancers walk.

    Shapes: -> (rows + 1, 2) metres.

    >>> all_at_once, later = stage_spots(3, rows=9), stage_spots(3, rows=2, first=4)
    >>> torch.equal(all_at_once[4:7], later), all_at_once[0].tolist()
    (True, [0.0, 0.0])
    """
    draws = row_generators(seed, SPOTS, rows + 1, first)
    spots = SPREAD * torch.stack([torch.randn(2, generator=draw) for draw in draws])
    if first == 0:
        spots[0] = 0
    return spots


@dataclass(frozen=True)
class StageSpots:
    """The hook that conditions every guess (l, f, d) on where its segment begins and ends.

    Differs from `ConstraintHook`: for solos, and always as wide as the linear guess needs.
    """

    constraint: Constraint
    std: Tensor

    def apply(self, x0_hat: Tensor, abar: float) -> Tensor:
        """A guess made where ``abar`` of the signal is left."""
        return self.constraint.condition(x0_hat[None], abar, self.std)[0]


def stage_spots_hook(spots: Tensor, frames: int, normalizer: Normalizer, std: Tensor) -> StageSpots:
    """Guesses begin in the middle, as training windows do, and end as far on as the next spot.

    Shapes: spots (l + 1, 2) metres.

    >>> std = (1 / (1 + torch.arange(64.0)[:, None]) ** 2).expand(64, 139)
    >>> scale = Normalizer(-torch.ones(139), torch.ones(139))
    >>> walk = torch.linspace(0, 3, 64)[None, :, None].expand(1, 64, 139)
    >>> spots = torch.tensor([[0.5, 0.0], [0.5, 0.25]])
    >>> x = stage_spots_hook(spots, 64, scale, std).apply(walk, abar=0.5)
    >>> x[0, -1, [3, 4, 5, 6]].round(decimals=2).tolist()  # x and z of the root are 4 and 6
    [3.0, 0.0, 3.0, 0.25]
    """
    y = torch.zeros(len(spots) - 1, frames, LODGE.dim)
    y[:, -1, LODGE.floor] = spots.diff(dim=0)
    y = normalizer.normalize(y)
    mask = torch.zeros(y.shape, dtype=torch.bool)
    mask[:, [0, -1], LODGE.floor] = True
    return StageSpots(Constraint(mask, y), std.cpu())
