r"""Root stitching: where a segment begins, the dancer goes on from where the one before ended.

Read first: notebook 12 · Lodge "Parallel Inference".

Every local segment starts near x = z = 0, and the paper says nothing of the root at seams; put side
by side, as the released code does it, dancers jump back by up to a metre.

Symbols (axes: L local segments · n frames of one · F frames of the dance · d motion features)
    v      velocity of the root, metres a frame
"""

import torch
from torch import Tensor

from dancediff.motion.representation import LODGE


def root_stitching(x: Tensor, *, blend: int = 8) -> Tensor:
    r"""Put locals one after another so that the root goes on without a jump.

    On the floor each local continues where the one before ended, with the mean of both velocities
    in between, and within ``blend`` frames on both sides the velocities approach that mean v':

    $$v' = \tfrac12 (v^{-} + v^{+}), \qquad v_i \leftarrow v_i + w_i\,(v' - v^{\mp}), \qquad
      w_i = \tfrac12 (1 + \cos(\pi i / B)), \quad i = 1 \dots B - 1$$

    A height cannot be continued like this without drifting off the floor; the gap e that is left
    in it is closed over the same frames instead, $y_i \pm w_i\,e / 2$. Everything else is taken as
    it is: contacts and rotations meet because both sides hold half of one hard primitive.

    That a dance does not walk off the stage is up to the sampler
    (`dancediff.extensions.stage_spots`): moving a finished path would make planted feet slide.

    Shapes: x (L, n, d) metres and 6-D rotations -> (L n, d).  Units of velocities: metres a frame.
    Raises: ValueError for a blend outside 0 ... n / 2.

    >>> x = torch.zeros(2, 32, 139)
    >>> x[..., 4] = torch.arange(32.0)                    # both walk a metre a frame from 0
    >>> root_stitching(x)[:, 4].equal(torch.arange(64.0))
    True
    """
    n = x.shape[1]
    if not 0 <= blend <= n // 2:
        raise ValueError(f"blend={blend} must lie in 0 ... {n // 2}, half a local")
    if n < 2:
        raise ValueError(f"x has shape {tuple(x.shape)}; a local of one frame has no velocity")
    y = x.flatten(0, 1).clone()
    root = x[..., LODGE.root].double()
    for axis in (0, 2):
        y[:, LODGE.root.start + axis] = _path(root[..., axis], blend).to(y)
    y[:, LODGE.root.start + 1] = _height(root[..., 1], blend).to(y)
    return y


def _path(p: Tensor, blend: int) -> Tensor:
    """One coordinate on the floor: (L, n) -> (L n,), by adding up mended velocities."""
    n, v = p.shape[1], torch.zeros_like(p)
    v[:, 1:] = p.diff(dim=1)
    before, after = v[:-1, -1].clone(), v[1:, 1].clone()
    v[1:, 0] = (before + after) / 2
    w = _fade(blend).to(p)[1:]  # the seam itself is done
    k = min(len(w), n - 1)
    v[1:, 1 : k + 1] -= (after - before)[:, None] / 2 * w[:k]
    v[:-1, n - k :] += (after - before)[:, None] / 2 * w[:k].flip(0)
    return p[0, 0] + v.flatten().cumsum(0)


def _height(p: Tensor, blend: int) -> Tensor:
    """Heights: (L, n) -> (L n,), the gap at each seam closed from both sides."""
    step = (p[:-1, -1] - p[:-1, -2] + p[1:, 1] - p[1:, 0]) / 2
    gap = (p[1:, 0] - p[:-1, -1] - step)[:, None] / 2
    y, w = p.clone(), _fade(blend).to(p)
    y[1:, : len(w)] -= gap * w
    y[:-1, p.shape[1] - len(w) :] += gap * w.flip(0)
    return y.flatten()


def _fade(blend: int) -> Tensor:
    """From 1 at a seam to nearly 0 ``blend`` frames away, (blend,)."""
    return (1 + torch.cos(torch.pi * torch.arange(blend, dtype=torch.float64) / blend)) / 2
