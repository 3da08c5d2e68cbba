r"""Turning: no joint turns further from one frame to the next than bodies do.

Read first: notebook 09 · `dancediff.extensions.foot_contact_projection`.

A network that cannot decide between two poses draws a mean of their 6-D rotations; where that mean
passes near zero, the rotation it stands for turns over within a frame.

Symbols (axes: f frames · j joints)
    R       rotation of each joint relative to its parent    (..., f, j, 3, 3)
    angle   how far a joint turns until the next frame       (..., f - 1, j) radians
    q       the same rotations as quaternions, signs alike   (..., f, j, 4)
    held    frames that must stay as they are                (..., f) bool
"""

import math

import roma
import torch
from torch import Tensor

from dancediff.motion.banded import bends, nearness, solve_banded
from dancediff.motion.representation import TCDIFFPP, MotionSpec
from dancediff.motion.rotation import matrix_to_rot6d, rot6d_to_matrix

ROOT_LIMIT = math.radians(25)  # a frame at 30 fps: two turns a second
JOINT_LIMIT = math.radians(50)
SMOOTH = 0.01  # what bending costs; away from jumps nothing is smoothed
HELD = 1e8  # what changing a frame costs that must stay
FREE = 1e-6  # and one that is too near to a jump


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
    x: Tensor, held: Tensor | None = None, spec: MotionSpec = TCDIFFPP, *, fps: float = 30.0
) -> Tensor:
    r"""Spread a turn that is too fast over as many frames as it takes.

    $$\min_{q'} \sum_i w_i \lVert q'_i - q_i \rVert^2 + S\,\lVert \Delta^2 q'_i \rVert^2$$

    w is 0 for so many frames on both sides of the jump that its angle, divided by them, is within
    the limit: 25 degrees a frame for the root, 50 for other joints. Joints that never turn too
    fast keep their numbers to the last bit.

    Source: ours.

    Shapes: x (..., f, d) metres and 6-D rotations, held (..., f) bool -> (..., f, d).

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
    alike = (q[:, 1:] * q[:, :-1]).sum(-1, keepdim=True).sign()
    q[:, 1:] *= alike.where(alike != 0, torch.ones(())).cumprod(1)
    weight = _weights(times_too_fast.movedim(-1, -2)[pick])
    if held is not None:
        weight = weight.masked_fill(held.expand(x.shape[:-1])[pick[:-1]], HELD)
    q = _through(q, weight)
    out = x.clone()
    rot6d = out[..., spec.rot6d].unflatten(-1, (spec.num_joints, 6)).movedim(-2, -3).clone()
    rot6d[pick] = matrix_to_rot6d(roma.unitquat_to_rotmat(q)).to(x)
    out[..., spec.rot6d] = rot6d.movedim(-3, -2).flatten(-2)
    return out if held is None else torch.where(held[..., None], x, out)


def _weights(times_too_fast: Tensor) -> Tensor:
    """What changing each frame costs, (k, f - 1) -> (k, f): nothing near jumps."""
    k, steps = times_too_fast.shape
    frames = torch.arange(steps + 1, device=times_too_fast.device)
    weight = torch.ones(k, steps + 1, dtype=torch.float64, device=times_too_fast.device)
    for row, at in (times_too_fast > 1).nonzero().tolist():
        reach = math.ceil(times_too_fast[row, at].item()) // 2 + 1
        weight[row, (frames > at - reach) & (frames <= at + reach)] = FREE
    return weight


def _through(q: Tensor, weight: Tensor) -> Tensor:
    """Unit quaternions near q that bend as little as can be, (k, f, 4)."""
    A = nearness(weight) + SMOOTH * bends(q.shape[1]).to(weight)
    smooth = solve_banded(A, weight[..., None] * q.double())
    return (smooth / smooth.norm(dim=-1, keepdim=True)).to(q)
