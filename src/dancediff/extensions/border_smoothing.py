r"""Border smoothing: a dance that arrives at hard cues without a jerk, and leaves them so.

Read first: notebook 12 (cues) · `dancediff.motion.banded`.

Symbols (axes: l local segments · f frames · d motion features)
    x      a guess that already has the cues in it   (l, f, d)
    hard   frames of hard cues                       (l, f) bool
    e      a border between a hard and a free frame
    u      how far a rotation is moved               (l, f, channels)
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from dancediff.extensions.projection import MORE_SIGNAL
from dancediff.motion.banded import nearness, solve_banded, weighted_bends
from dancediff.motion.representation import LODGE

SMOOTH = 100.0  # what a change of u's speed costs; moving by as much costs 1
NO_JERK = 300.0  # what a change of the dance's own speed costs at a border
FADE = 2.0  # frames from a border in which that falls to a third
FIXED = 1e12  # what moving costs where a cue is


@dataclass(frozen=True)
class BorderSmoothing:
    """The hook that puts hard cues into guesses that are more signal than noise."""

    hard: Tensor
    y: Tensor
    frames: Tensor

    def apply(self, x0_hat: Tensor, abar: float) -> Tensor:
        """A guess (l, f, d)."""
        if abar < MORE_SIGNAL:
            return x0_hat
        return smooth_borders(torch.where(self.hard, self.y.to(x0_hat), x0_hat), self.frames)


def smooth_borders(x: Tensor, hard: Tensor) -> Tensor:
    r"""Move the free frames around hard ones a little, so that no joint starts or stops at once.

    $$\min_u \sum_i \Big[\lVert u_i \rVert^2 + S\,\lVert \Delta^2 u_i \rVert^2
      + w_i\,\lVert \Delta^2 x_i + \Delta^2 u_i \rVert^2\Big], \qquad
      w_i = J \sum_e e^{-|i - e| / 2}, \quad u = 0 \text{ in hard frames}$$

    A network that is given clean frames copies them and dances on beside them. Only rotations are
    moved. What it brings: docs/ablations.md.

    Source: ours; the paper holds its cues and says nothing of the frames beside them.

    Shapes: x (l, f, d), hard (l, f) -> (l, f, d).

    >>> x, hard = torch.zeros(1, 40, 139), torch.arange(40)[None] < 4
    >>> x[:, 4:, 10] = 1.0                                    # a jump where the cue ends
    >>> joined = smooth_borders(x, hard)
    >>> bool((joined[:, :4] == 0).all()), bool(joined[0, :, 10].diff().abs().max() < 0.3)
    (True, True)
    """
    free = ~hard.to(x.device)
    w = NO_JERK * _nearness_to_borders(hard).to(x.device)
    part = x[..., LODGE.rot6d].double()
    pull = w[..., None] * part.diff(n=2, dim=-2)
    b = -_transposed_bend(pull)
    stay = torch.where(free, 1.0, FIXED).double()
    u = solve_banded(nearness(stay) + weighted_bends(SMOOTH + w), b)
    moved = x.clone()
    moved[..., LODGE.rot6d] += (u * free[..., None]).to(x)
    return moved


def _nearness_to_borders(hard: Tensor) -> Tensor:
    """1 at the frames on both sides of a border, less away from it: (l, f) -> (l, f - 2)."""
    border = (hard[:, 1:] != hard[:, :-1]).double().cpu()
    centre, e = torch.arange(1, hard.shape[1] - 1)[:, None], torch.arange(border.shape[1])
    away = torch.maximum(e - centre, centre - e - 1).clamp_min(0)
    return border @ torch.exp(-away / FADE).double().mT


def _transposed_bend(y: Tensor) -> Tensor:
    """The transpose of the second difference: (l, f - 2, c) -> (l, f, c)."""
    none = torch.zeros_like(y[:, :1])
    parts = [
        torch.cat([none] * k + [weight * y] + [none] * (2 - k), dim=1)
        for k, weight in enumerate((1.0, -2.0, 1.0))
    ]
    return torch.stack(parts).sum(0)
