r"""Order constraint: dancers who were asked to change places end in that order.

Read first: notebook 09 · `dancediff.motion.order` · `dancediff.extensions.constraint`.

Symbols (axes: n dancers · f frames · d motion features)
    S   swap mode: S[k] = the dancer, counted from the left at the first frame, who ends k-th   (n,)
    x   lateral place of everybody in a frame of a guess, metres; numbered as S does            (n,)
    y   where they would stand in the order that was asked for                                  (n,)

The network is given S, and mostly follows it. Where a guess does not, it is conditioned on the
nearest places that are in order: whole paths turn while there is much noise, and nothing moves in
the end.
"""

from dataclasses import dataclass, replace

import torch
from scipy.optimize import isotonic_regression
from torch import Tensor

from dancediff.diffusion.long_sampling import Segment
from dancediff.extensions.collision_avoidance import SAYS_WHERE, SLACK
from dancediff.extensions.constraint import Constraint
from dancediff.motion.representation import TCDIFFPP, Normalizer

GAP = 0.45  # metres from left to right between neighbours; 95 % of the choreographed have more
START_GAP = 0.3  # where a dance begins
HOLD = 30  # frames at either end that are asked, but at most a third of them; with one frame
# alone feet and the next guess bring dancers back, and 104 of 120 trios obey instead of all
X = TCDIFFPP.lateral


def in_order(x: Tensor, S: Tensor, gap: float = GAP) -> Tensor:
    r"""The places nearest to x at which dancers stand in the order S.

    $$y = \arg\min_y \lVert y - x \rVert^2 \quad\text{with}\quad
      y_{S_{k+1}} - y_{S_k} \ge \text{gap}$$

    Isotonic regression of x, less a gap for everybody further left.

    Shapes: x (n,) metres, S (n,) -> (n,) metres.

    >>> in_order(torch.tensor([-1.0, 1.0]), torch.tensor([0, 1])).tolist()     # they are
    [-1.0, 1.0]
    >>> in_order(torch.tensor([0.0, 1.0]), torch.tensor([1, 0]), gap=0.5).tolist()
    [0.75, 0.25]
    """
    steps = gap * torch.arange(len(x), dtype=torch.float64)
    sorted_x = x.cpu().double()[S.cpu()] - steps
    placed = torch.from_numpy(isotonic_regression(sorted_x.numpy()).x) + steps
    y = torch.empty_like(placed)
    y[S.cpu()] = placed
    return y.to(x)


@dataclass(frozen=True)
class OrderConstraint:
    """A `Source` of `ConstraintHook`: dancers are asked to stand in the order S in the last frames.

    Where a dance begins, unless its start is told, they also stand as they are numbered: two who
    start in each other's place each end where the other should. All frames near an end move alike.

    >>> rule = OrderConstraint(Normalizer(-torch.ones(151), torch.ones(151)), torch.tensor([1, 0]))
    >>> asked = rule.at(torch.zeros(2, 30, 151), 0.5)
    >>> frames = asked.mask[0, :, X].nonzero().flatten().tolist()
    >>> frames[0], frames[-1], (asked.value[0, -1, X] > asked.value[1, -1, X]).item()
    (20, 29, True)
    """

    normalizer: Normalizer
    S: Tensor = None  # type: ignore[assignment] # that of a segment, see `for_segment`
    starts: bool = False  # the segment is the first of a dance, and nobody's start is told

    def for_segment(self, segment: Segment) -> "OrderConstraint | None":
        """With the S of a segment; None where no order was asked for."""
        if segment.target is None:
            return None
        free = segment.context is None and not segment.mask[:, 0, X].any()
        return replace(self, S=segment.row[segment.target], starts=free)

    def at(self, guess: Tensor, abar: float) -> Constraint | None:
        """Where everybody is asked to start and to end (n, f, d), or None if they are in order."""
        if abar <= SAYS_WHERE:
            return None
        hold = min(HOLD, guess.shape[1] // 3)
        asked = [(slice(-hold, None), in_order(self._x(guess, -1), self.S) - self._x(guess, -1))]
        if self.starts:
            ranks = torch.arange(len(guess))
            start = in_order(self._x(guess, 0), ranks, START_GAP) - self._x(guess, 0)
            asked.append((slice(0, hold), start))
        scale = self.normalizer.scale.to(guess)
        mask, value = torch.zeros_like(guess, dtype=torch.bool), guess.clone()
        for frames, step in asked:
            if step.abs().max() >= SLACK / 10:
                mask[:, frames, X] = True
                value[:, frames, X] += step[:, None] / scale[X]
        if not mask.any():
            return None
        return Constraint(mask, value, torch.full_like(guess, SLACK) / scale)

    def _x(self, guess: Tensor, frame: int) -> Tensor:
        """Lateral places in a frame, metres; (n, f, d) -> (n,)."""
        return self.normalizer.unnormalize(guess[:, frame])[:, X]
