r"""Do the dancers of a group do the same at the same time?

Read first: docs/metrics_group.md.

Symbols (axes: n dancers · f frames · j joints)
    joints  positions, metres, y up                               (n, f, j, 3)
    v       velocities of joints, less that of their own root     (n, f - 1, 3 j)
"""

from itertools import combinations

import torch
from torch import Tensor

from dancediff.metrics.inputs import as_group

STILL = 1e-3  # metres a second: the root mean square below which a dancer does nothing


def unison(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""Correlation of two dancers' movements, mean over all pairs: 1 in unison, 0 for strangers.

    $$\text{unison} = \frac{2}{n(n-1)}\sum_{d<e}
        \frac{\sum_i v_d(i)\cdot v_e(i)}{\lVert v_d\rVert\,\lVert v_e\rVert}$$

    Where a dancer stands and travels does not matter. A pair one of whom does nothing has 0. Mirror
    images and canons are dancing together, too, and this does not see it.

    Source: ours. GMC asks the same question, but grows with any movement.

    Shapes: joints (n, f, j, 3) metres, in one world -> -1 to 1.
    Raises: ValueError for fewer than 2 dancers or 2 frames, or NaN.

    >>> wave = torch.randn(1, 90, 24, 3, generator=torch.Generator().manual_seed(0)).cumsum(1)
    >>> round(unison(wave.expand(3, -1, -1, -1)), 3)
    1.0
    >>> unison(torch.zeros(2, 10, 24, 3))
    0.0
    """
    joints = as_group(joints, fps, least=2, dancers=2)
    v = (joints - joints[:, :, :1]).diff(dim=1).flatten(1) * fps
    moves = v.square().mean(1).sqrt() > STILL
    v = torch.where(moves[:, None], v / v.norm(dim=1, keepdim=True).clamp_min(1e-12), 0)
    pairs = combinations(range(len(v)), 2)
    return float(torch.stack([v[d] @ v[e] for d, e in pairs]).mean())
