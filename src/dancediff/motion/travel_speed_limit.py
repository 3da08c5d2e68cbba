r"""Travelling: nobody crosses the floor faster than dancers run.

Read first: notebook 09 · `dancediff.extensions.foot_contact_projection`.

Symbols (axes: f frames)
    p      where the root stands on the floor, x and z           (..., f, 2) metres
    v      its step to the next frame                            (..., f - 1, 2)
    lack   what steps that are too long must give away           (..., f - 1, 2)
    w      how much of it another step takes over                (..., f - 1, f - 1)
    held   frames in which the root must stay where it is        (..., f) bool
"""

import torch
from torch import Tensor

from dancediff.motion.representation import TCDIFFPP, MotionSpec

LIMIT = 3.3  # m/s: as fast as the fastest dancer of the training set; most never pass 1.4
AROUND = 6.0  # frames at 30 fps: the steps about so near help most
ROUNDS = 50  # helpers may become too long themselves, and ask others


def limit_travel(
    x: Tensor, held: Tensor | None = None, spec: MotionSpec = TCDIFFPP, *, fps: float = 30.0
) -> Tensor:
    r"""Spread a dash over so many steps that each is within the limit; where it leads to stays.

    $$v' = v - \text{lack} + \sum_j w_{ij}\,\text{lack}_j, \quad
      \text{lack} = v\,[1 - \text{limit} / \lVert v \rVert]_+, \quad \sum_i w_{ij} = 1$$

    again and again until nothing is lacking. Helpers lie between the same two held frames, so
    those stay; where these are further apart than a dancer can run, she runs too fast. Who never
    does keeps her numbers to the last bit.

    Source: ours.

    Shapes: x (..., f, d) metres, held (..., f) bool -> (..., f, d).

    >>> x = torch.zeros(40, TCDIFFPP.dim)
    >>> x[20:, TCDIFFPP.lateral] = 0.6                              # 60 cm in a frame
    >>> y = limit_travel(x)[:, TCDIFFPP.lateral]
    >>> round(y.diff().max().item(), 2), round(y[0].item(), 3), round(y[-1].item(), 3)
    (0.11, 0.0, 0.6)
    """
    p, longest = x[..., spec.floor].clone(), LIMIT / fps
    fast = (p.diff(dim=-2).norm(dim=-1) > longest).any(-1)
    if not fast.any():
        return x
    path = p[fast].double()
    v = path.diff(dim=-2)
    held = torch.zeros_like(p[..., 0]) if held is None else held.expand(p.shape[:-1])
    w = _shares(held[fast], fps)
    for _ in range(ROUNDS):
        lack = v * (1 - longest / v.norm(dim=-1, keepdim=True).clamp_min(longest))
        if lack.norm(dim=-1).max() < longest / 1000:
            break
        v = v - lack + w @ lack
    moved = torch.cat([path[:, :1], path[:, :1] + v.cumsum(-2)], -2)
    moved = torch.where((moved - path).norm(dim=-1, keepdim=True) > 1e-6, moved, path)
    p[fast] = moved.to(x)
    out = x.clone()
    out[..., spec.floor] = p
    return out


def _shares(held: Tensor, fps: float) -> Tensor:
    """What every step takes over from every other, (k, f - 1, f - 1); each gives away all."""
    between = held[:, :-1].long().cumsum(-1)  # held frames up to each step
    frames = torch.arange(between.shape[-1], dtype=torch.float64, device=held.device)
    near = torch.exp(-(((frames[:, None] - frames) * 30 / fps / AROUND) ** 2) / 2)
    w = near * (between[:, :, None] == between[:, None, :])
    return w / w.sum(-2, keepdim=True)
