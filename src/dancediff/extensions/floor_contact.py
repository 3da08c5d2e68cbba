r"""Floor contact: bodies stand on the floor unless they leap.

Read first: notebook 09 · `dancediff.extensions.projection`.

Symbols (axes: f frames · j joints)
    h       how far the lowest joint is above where a toe stands, metres   (..., f)
    v       how far a body is lifted, metres                               (..., f)
    T       how long no joint was near the floor, seconds
    g       gravity, 9.81 m/s^2
"""

import torch
from torch import Tensor

from dancediff.extensions.projection import Fixed
from dancediff.motion.banded import bends, nearness, solve_banded
from dancediff.motion.contact import TOE_CLEARANCE
from dancediff.motion.representation import TCDIFFPP, MotionSpec, joints_of

GRAVITY = 9.81  # metres a second squared
AIR = 0.02  # metres: a body higher than that is in the air
LEGS_REACH = 0.4  # of the height of a throw that feet rise at least; legs reach for the floor
SMOOTH = 50.0  # what a change of v's speed costs, a step of 1 costs 1
FIXED = 1e8  # what lifting a body costs where its height is known


def floor_contact(x: Tensor, fixed: Fixed) -> Tensor:
    """Put bodies on the floor, see `project_floor_contact`.

    Shapes: x (..., f, d) metres and 6-D rotations -> the same.
    """
    return project_floor_contact(x, fixed.height, fixed.spec)


def flights(h: Tensor, *, fps: float = 30.0) -> Tensor:
    r"""Frames of leaps: a body in the air for a time T that its height allows.

    $$\max h \ge 0.4\,\frac{g T^2}{8}$$

    Who is in the air for longer does not leap but floats.

    Source: ours; the flight of a body that is thrown up.

    Shapes: h (..., f) metres -> (..., f) bool.

    >>> flights(torch.tensor([0.0, 0.05, 0.1, 0.05, 0.0, 0.0])).tolist()
    [False, True, True, True, False, False]
    >>> flights(torch.full((60,), 0.1)).any().item()                   # two seconds at 10 cm
    False
    """
    air = h > AIR
    run = (~air).cumsum(-1)  # frames of one run in the air share a number
    zeros = torch.zeros(*h.shape[:-1], h.shape[-1] + 1, dtype=h.dtype, device=h.device)
    peak = zeros.scatter_reduce(-1, run, h.where(air, zeros[..., :-1]), "amax").gather(-1, run)
    T = zeros.scatter_add(-1, run, air.to(h.dtype)).gather(-1, run) / fps
    return air & (peak >= LEGS_REACH * GRAVITY * T**2 / 8)


def floor_contact_shift(h: Tensor, fixed: Tensor | None = None) -> Tensor:
    r"""How far to lift a body in every frame so that it stands on the floor unless it leaps.

    $$\min_v \sum_{i \notin \text{leap}} (v_i + h_i)^2 + S \sum_i (\Delta^2 v)_i^2$$

    Source: ours.

    Shapes: h (..., f) metres, fixed (..., f) bool -> (..., f) metres.

    >>> round(floor_contact_shift(torch.full((40,), 0.1))[0].item(), 3)    # floats: down by 10 cm
    -0.1
    """
    f = h.shape[-1]
    weight = 1 - flights(h.detach()).double() * (1 - 1e-6)
    target = -h.double()
    if fixed is not None:
        weight, target = weight.masked_fill(fixed, FIXED), target.masked_fill(fixed, 0)
    A = nearness(weight) + SMOOTH * bends(f).to(weight)
    return solve_banded(A, (weight * target)[..., None])[..., 0].to(h)


def project_floor_contact(
    x: Tensor, fixed: Tensor | None = None, spec: MotionSpec = TCDIFFPP
) -> Tensor:
    """Put bodies that float or sink on the floor; only the height of the root changes.

    Source: ours.

    Shapes: x (..., f, d), fixed (..., f) bool -> (..., f, d), with the d of ``spec``.

    >>> from dancediff.motion.representation import pack
    >>> x = pack(torch.zeros(90, 4), torch.zeros(90, 3) + 2, torch.eye(3).expand(90, 24, 3, 3))
    >>> lowest = joints_of(project_floor_contact(x))[..., 1].amin(-1)
    >>> round(lowest.mean().item(), 3)
    0.02
    """
    h = joints_of(x, spec)[..., 1].amin(-1) - TOE_CLEARANCE
    out = x.clone()
    out[..., spec.height] += floor_contact_shift(h, fixed)
    return out
