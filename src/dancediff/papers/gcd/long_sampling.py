r"""Long dances of GCD: all segments at once, whose dancers find each other in every step.

Read first: Le et al. 2023 (GCD) section 3.6 · `dancediff.motion.blend`.

Symbols (axes: k segments of the same dance · n dancers · f frames of a segment · o frames shared
         d motion features)
    x       guesses of all segments               (k, n, f, d)
    order   order[i] = the dancer of the later segment who goes on as dancer i    (n,)
"""

from dataclasses import dataclass

import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from dancediff.motion.blend import cross_fade
from dancediff.motion.representation import Normalizer


def matched(first: Tensor, second: Tensor) -> Tensor:
    r"""Which dancer of the second version is which of the first: the cheapest assignment.

    $$\pi = \arg\min_\pi \sum_i \lVert a_i - b_{\pi(i)} \rVert^2$$

    Source: GCD section 3.6 (Hungarian method on the distance of poses).  Differs: places count as
    well as poses; the paper does not say whether its blending keeps them.

    Shapes: first, second (n, o, d) normalised -> (n,).

    >>> x = torch.randn(3, 5, 151)
    >>> matched(x, x[[2, 0, 1]]).tolist()
    [1, 2, 0]
    """
    cost = (first[:, None] - second[None]).square().mean(dim=(2, 3))
    return torch.as_tensor(linear_sum_assignment(cost.float().numpy())[1])


def in_one_order(x: Tensor, overlap: int) -> Tensor:
    """Renumber the dancers of every segment as those of the first.

    Shapes: x (k, n, f, d) normalised -> the same.

    >>> x = torch.randn(1, 3, 8, 151)
    >>> both = torch.cat([x, x[:, [2, 0, 1]].roll(-4, dims=2)])
    >>> torch.equal(in_one_order(both, overlap=4)[1, :, :4], x[0, :, 4:])
    True
    """
    segments = [x[0]]
    for segment in x[1:]:
        order = matched(segments[-1][:, -overlap:], segment[:, :overlap])
        segments.append(segment[order])
    return torch.stack(segments)


@dataclass(frozen=True)
class MatchedOverlaps:
    """Cross-fade the overlaps of all guesses, each dancer with the one who goes on in its place.

    A hook on guesses, for `dancediff.diffusion.samplers.sample`. Both segments get the blend.

    Source: GCD section 3.6.  Differs: the guess is blended, not the noisy motion, which would lose
    noise by it.
    """

    overlap: int
    normalizer: Normalizer

    def apply(self, x0_hat: Tensor, abar: float) -> Tensor:
        """Shapes: x0_hat (k, n, f, d) normalised -> the same."""
        x, o = x0_hat.clone(), self.overlap
        for i in range(len(x) - 1):
            order = matched(x[i, :, -o:], x[i + 1, :, :o])
            first, second = x[i, :, -o:], x[i + 1, order, :o]
            metres = [self.normalizer.unnormalize(one) for one in (first, second)]
            blend = self.normalizer.normalize(cross_fade(*metres))
            x[i, :, -o:] = blend
            x[i + 1, order, :o] = blend
        return x
