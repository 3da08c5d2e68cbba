r"""Speed limit: joints turn and dancers travel no faster than bodies do.

Read first: notebook 09 · `dancediff.extensions.projection`.

A network that cannot decide between two poses draws a mean of their 6-D rotations; where that mean
passes near zero, the rotation it stands for turns over within a frame.

Symbols (axes: f frames · j joints)
    R       rotation of each joint relative to its parent        (..., f, j, 3, 3)
    angle   how far a joint turns until the next frame           (..., f - 1, j) radians
    q       the same rotations as quaternions, signs alike       (..., f, j, 4)
    p       where the root stands on the floor, x and z          (..., f, 2) metres
    v       its step to the next frame                           (..., f - 1, 2)
    lack    what steps that are too long must give away          (..., f - 1, 2)
    w       how much of it another step takes over               (..., f - 1, f - 1)
    fixed   frames that must stay as they are                    (..., f) bool
"""

import math

import roma
import torch
from torch import Tensor

from dancediff.extensions.projection import Fixed
from dancediff.motion.banded import bends, nearness, solve_banded
from dancediff.motion.representation import TCDIFFPP, MotionSpec
from dancediff.motion.rotation import matrix_to_rot6d, rot6d_to_matrix

ROOT_LIMIT = math.radians(25)  # a frame at 30 fps: two turns a second
JOINT_LIMIT = math.radians(50)
SMOOTH = 0.01  # what bending costs; away from jumps nothing is smoothed
FIXED = 1e8  # what changing a frame costs that must stay
FREE = 1e-6  # and one that is too near to a jump
TRAVEL_LIMIT = 3.3  # m/s: as fast as the fastest dancer of the training set; most never pass 1.4
AROUND = 6.0  # frames at 30 fps: the steps about so near help most
ROUNDS = 50  # helpers may become too long themselves, and ask others


def speed_limit(x: Tensor, fixed: Fixed) -> Tensor:
    """Spread what is too fast over more frames; slower dancers are returned unchanged.

    Shapes: x (..., f, d) metres and 6-D rotations -> the same.
    """
    x = limit_turns(x, fixed.frames(fixed.spec.rot6d), fixed.spec)
    return limit_travel(x, fixed.place, fixed.spec)


def turn_angles(R: Tensor) -> Tensor:
    """How far each joint turns from frame to frame.

    Shapes: R (..., f, j, 3, 3) -> (..., f - 1, j) radians.

    >>> R = torch.stack([torch.eye(3), torch.diag(torch.tensor([1.0, -1.0, -1.0]))])
    >>> round(turn_angles(R[:, None]).item(), 3)                        # a half turn about x
    3.142
    """
    trace = (R[..., :-1, :, :, :] * R[..., 1:, :, :, :]).sum((-1, -2))
    return torch.acos(((trace - 1) / 2).clamp(-1, 1))


def limit_turns(
    x: Tensor, fixed: Tensor | None = None, spec: MotionSpec = TCDIFFPP, *, fps: float = 30.0
) -> Tensor:
    r"""Spread a turn that is too fast over as many frames as it takes.

    $$\min_{q'} \sum_i w_i \lVert q'_i - q_i \rVert^2 + S\,\lVert \Delta^2 q'_i \rVert^2$$

    w is 0 for so many frames on both sides of the jump that its angle, divided by them, is within
    the limit: 25 degrees a frame for the root, 50 for other joints. Joints that never turn too
    fast are returned unchanged.

    Source: ours.

    Shapes: x (..., f, d) metres and 6-D rotations, fixed (..., f) bool -> (..., f, d).

    >>> from dancediff.motion.representation import pack
    >>> R = torch.eye(3).repeat(40, 24, 1, 1)
    >>> R[20:, 0] = torch.diag(torch.tensor([-1.0, 1.0, -1.0]))           # faces about in no time
    >>> x = limit_turns(pack(torch.zeros(40, 4), torch.zeros(40, 3), R))
    >>> R = rot6d_to_matrix(x[..., 7:].unflatten(-1, (24, 6)))
    >>> bool(turn_angles(R).rad2deg().max() < 30)
    True
    """
    R = rot6d_to_matrix(x[..., spec.rot6d].unflatten(-1, (spec.num_joints, 6)))
    limit = R.new_full((spec.num_joints,), JOINT_LIMIT) * 30 / fps
    limit[0] = ROOT_LIMIT * 30 / fps
    times_too_fast = turn_angles(R.detach()) / limit
    wild = (times_too_fast > 1).any(-2)
    if not wild.any():
        return x
    pick = wild.nonzero(as_tuple=True)  # dancer ..., joint
    q = roma.rotmat_to_unitquat(R.movedim(-3, -4)[pick])
    weight = _weights(times_too_fast.movedim(-1, -2)[pick])
    if fixed is not None:
        weight = weight.masked_fill(fixed.expand(x.shape[:-1])[pick[:-1]], FIXED)
    q = torch.stack([_signs_alike(*row) for row in zip(q, weight, strict=True)])
    q = _through(q, weight)
    out = x.clone()
    rot6d = out[..., spec.rot6d].unflatten(-1, (spec.num_joints, 6)).movedim(-2, -3).clone()
    rot6d[pick] = matrix_to_rot6d(roma.unitquat_to_rotmat(q)).to(x)
    out[..., spec.rot6d] = rot6d.movedim(-3, -2).flatten(-2)
    return out if fixed is None else torch.where(fixed[..., None], x, out)


def _weights(times_too_fast: Tensor) -> Tensor:
    """What changing each frame costs, (k, f - 1) -> (k, f): nothing near jumps."""
    k, steps = times_too_fast.shape
    frames = torch.arange(steps + 1, device=times_too_fast.device)
    weight = torch.ones(k, steps + 1, dtype=torch.float64, device=times_too_fast.device)
    for row, at in (times_too_fast > 1).nonzero().tolist():
        reach = math.ceil(times_too_fast[row, at].item()) // 2 + 1
        weight[row, (frames > at - reach) & (frames <= at + reach)] = FREE
    return weight


def _signs_alike(q: Tensor, weight: Tensor) -> Tensor:
    """Of q and -q, which are the same rotation, the one like that of the last frame that counts.

    So a jump is bridged the short way: two jumps beside each other may turn a body once around, and
    between q before and -q behind them lies no rotation but zero.

    Shapes: q (f, 4), weight (f,) -> (f, 4).
    """
    frames = torch.arange(len(q), device=q.device)
    counts = (weight > FREE).nonzero()[:, 0]
    if not len(counts):
        counts = frames
    known = q[counts]
    alike = _sign((known[1:] * known[:-1]).sum(-1, keepdim=True))
    known = torch.cat([known[:1], known[1:] * alike.cumprod(0)])
    last = (torch.searchsorted(counts, frames, right=True) - 1).clamp_min(0)
    return q * _sign((q * known[last]).sum(-1, keepdim=True))


def _sign(x: Tensor) -> Tensor:
    """1 or -1; 1 for 0."""
    return 1 - 2 * (x < 0).to(x)


def _through(q: Tensor, weight: Tensor) -> Tensor:
    """Unit quaternions near q that bend as little as can be, (k, f, 4)."""
    A = nearness(weight) + SMOOTH * bends(q.shape[1]).to(weight)
    smooth = solve_banded(A, weight[..., None] * q.double())
    return (smooth / smooth.norm(dim=-1, keepdim=True)).to(q)


def limit_travel(
    x: Tensor, fixed: Tensor | None = None, spec: MotionSpec = TCDIFFPP, *, fps: float = 30.0
) -> Tensor:
    r"""Spread a dash over so many steps that each is within the limit; where it leads to stays.

    $$v' = v - \text{lack} + \sum_j w_{ij}\,\text{lack}_j, \quad
      \text{lack} = v\,[1 - \text{limit} / \lVert v \rVert]_+, \quad \sum_i w_{ij} = 1$$

    again and again until nothing is lacking. Helpers lie between the same two fixed frames, so
    those stay, even if the way between them is too far for the limit. Slower dancers are
    returned unchanged (bit-identical).

    Source: ours.

    Shapes: x (..., f, d) metres, fixed (..., f) bool -> (..., f, d).

    >>> x = torch.zeros(40, TCDIFFPP.dim)
    >>> x[20:, TCDIFFPP.lateral] = 0.6                              # 60 cm in a frame
    >>> y = limit_travel(x)[:, TCDIFFPP.lateral]
    >>> round(y.diff().max().item(), 2), round(y[0].item(), 3), round(y[-1].item(), 3)
    (0.11, 0.0, 0.6)
    """
    p, longest = x[..., spec.floor].clone(), TRAVEL_LIMIT / fps
    fast = (p.diff(dim=-2).norm(dim=-1) > longest).any(-1)
    if not fast.any():
        return x
    path = p[fast].double()
    v = path.diff(dim=-2)
    fixed = torch.zeros_like(p[..., 0]) if fixed is None else fixed.expand(p.shape[:-1])
    w = _shares(fixed[fast], fps)
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


def _shares(fixed: Tensor, fps: float) -> Tensor:
    """What every step takes over from every other, (k, f - 1, f - 1); each gives away all."""
    between = fixed[:, :-1].long().cumsum(-1)  # fixed frames up to each step
    frames = torch.arange(between.shape[-1], dtype=torch.float64, device=fixed.device)
    near = torch.exp(-(((frames[:, None] - frames) * 30 / fps / AROUND) ** 2) / 2)
    w = near * (between[:, :, None] == between[:, None, :])
    return w / w.sum(-2, keepdim=True)
