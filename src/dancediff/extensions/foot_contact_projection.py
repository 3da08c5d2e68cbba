r"""Foot-contact projection: feet that are said to stand do stand.

Read first: notebook 09 · `dancediff.extensions.projection`.

Symbols (axes: f frames · j the ankle and the toe of one foot)
    x       motion vectors, metres and 6-D rotations                       (..., f, d)
    p       ankle and toe                                                  (..., f, j, 3)
    c       how sure it is that they are planted until the next frame      (..., f, j)
    u       how far the foot is moved                                      (..., f, 3)
    v       how far the root follows                                       (..., f, 3)
    fixed    frames whose legs must stay as they are                        (..., f) bool
    rooted  frames and axes where the root must stay                       (..., f, 3) bool
"""

import torch
from torch import Tensor
from torch.nn.functional import avg_pool1d, max_pool1d, one_hot, pad

from dancediff.axes import ON_FLOOR
from dancediff.extensions.floor_contact import AIR, flights, floor_contact
from dancediff.extensions.projection import Fixed, Projection
from dancediff.extensions.speed_limit import speed_limit
from dancediff.motion.banded import bends, nearness, solve_banded, steps
from dancediff.motion.contact import TOE_CLEARANCE
from dancediff.motion.ik import two_bone_knee
from dancediff.motion.representation import TCDIFFPP, MotionSpec, Normalizer, unpack, whole_pose
from dancediff.motion.rotation import matrix_to_rot6d, rotation_between
from dancediff.motion.skeleton import FOOT_JOINTS, SMPL24, forward_kinematics, world_rotations

LEGS = [SMPL24.index(side + part) for side in "lr" for part in ("hip", "knee", "ankle", "toe")]
STAND = 1e4  # what a step of a planted foot costs; moving a foot by as much costs 1
SMOOTH = 50.0  # what a change of u's speed costs: a foot is hurried no more than dancers do
UNSURE, SURE = 0.3, 0.7  # contacts from which a foot counts as a little and as fully planted
FIXED = 1e8  # what moving a foot costs where the legs must stay, or the root
APART = 0.15  # metres between the ankles
QUARTER = 15  # frames: a quarter of a second to both sides
NEITHER = 1e-3  # how much a foot counts for the root that does not stand
STRAIGHT = 0.02  # metres; a knee bent less than that keeps to the front of the thigh
WEIGHT_SHIFT = 5  # frames over which the standing foot is chosen, if none is sure
TAKE_OFF = 2  # frames in which a body on its way up is still low
REACH = 0.1  # metres by which the other foot must be higher to make up for a sure contact
LOWEST = (0.05, 0.01)  # metres over the floor: ankle, toe; retargeted dances keep to the same


def foot_contact_projection(x: Tensor, fixed: Fixed) -> Tensor:
    """Move legs and root so that the feet which x itself says are standing do stand.

    Shapes: x (..., f, d) metres and 6-D rotations -> the same.
    """
    legs, rooted = fixed.frames(fixed.spec.joint_channels(LEGS)), None
    height, place = fixed.height, fixed.place
    if legs is not None and height is not None and place is not None:
        rooted = torch.stack([legs | place, legs | height, legs | place], -1)
    return project_foot_contact(x, legs, fixed.spec, rooted=rooted)


STEPS = (speed_limit, floor_contact, foot_contact_projection)


def foot_contact_hook(
    normalizer: Normalizer, mask: Tensor | None = None, spec: MotionSpec = TCDIFFPP
) -> Projection:
    """What ``foot_contact=True`` stands for: speed limit, floor contact, standing feet.

    >>> norm = Normalizer(-torch.ones(151), torch.ones(151))
    >>> x, hook = torch.randn(1, 2, 30, 151), foot_contact_hook(norm)
    >>> torch.equal(hook.apply(x, abar=0.4), x), torch.equal(hook.apply(x, abar=0.9), x)
    (True, False)
    """
    return Projection(normalizer, STEPS, Fixed(mask, spec))


def project_foot_contact(
    x: Tensor,
    fixed: Tensor | None = None,
    spec: MotionSpec = TCDIFFPP,
    *,
    rooted: Tensor | None = None,
) -> Tensor:
    r"""Let the legs follow feet that stand where x itself says that they stand.

    Where it says that of no foot and the body does not leap, one stands nevertheless (`support`).
    The feet are moved as little as that takes (`foot_contact_shift`) and keep their direction. The
    root follows the feet that stand (`root_shift`), and all above it with the root; hips, knees and
    ankles do the rest by two-bone inverse kinematics, so that a foot out of the leg's reach still
    slides. Feet are parted where legs close or cross (`legs_apart`). Without the root's part legs
    reach for their feet: segment after segment of a long dance they got straighter, until knees
    were stiff (docs/drift.md).

    Source: ours. PhysDiff (Yuan et al. 2023) puts a projection to physically possible motion at
    the same place, between the network's guess and the next step of sampling.

    Shapes: x (..., f, d), fixed (..., f), rooted (..., f, 3), by default where the legs are fixed
    -> (..., f, d), with the d of ``spec``.

    >>> from dancediff.motion.representation import pack
    >>> slide = torch.zeros(30, 3)
    >>> slide[:, 0], slide[:, 1] = torch.linspace(0, 0.2, 30), 0.93    # 20 cm to the left, upright
    >>> x = pack(torch.ones(30, 4), slide, torch.eye(3).expand(30, 24, 3, 3))
    >>> _, root, pose = unpack(project_foot_contact(x))
    >>> bool(forward_kinematics(pose, root)[:, 7].diff(dim=0).norm(dim=-1).max() < 0.001)
    True
    """
    contact, root, pose = unpack(x, spec)
    pose = whole_pose(pose)
    joints, Q = forward_kinematics(pose, root), world_rotations(pose)
    contact = support(contact, joints)

    # 1. how far either foot has to move, and how far the root follows them
    feet = joints[..., FOOT_JOINTS, :]  # left and right ankle, left and right toe
    apart = legs_apart(joints, fixed)
    u = []
    for k, aside in enumerate((apart, -apart)):
        foot = feet[..., k::2, :] + aside[..., None, :]
        u.append(aside + foot_contact_shift(foot, contact[..., k::2], fixed))
    if rooted is None and fixed is not None:
        rooted = fixed[..., None].expand(*fixed.shape, 3)
    v = root_shift(torch.stack(u, -2), contact, rooted)
    planted = x.clone()
    planted[..., spec.root] += v

    # 2. legs reach from where their hips are now to where their feet shall be
    for k, side in enumerate("lr"):
        leg = [SMPL24.index(side + part) for part in ("hip", "knee", "ankle", "toe")]
        hip, knee, ankle, _ = (joints[..., leg, :] + v[..., None, :]).unbind(-2)
        rotations = _leg(hip, knee, ankle, ankle + u[k] - v, Q, leg)
        for joint, R in zip(leg, rotations, strict=False):  # the toe stays as it is on the foot
            planted[..., spec.joint_channels([joint])] = matrix_to_rot6d(R)
    if fixed is not None:
        planted = torch.where(fixed[..., None], x, planted)
    return planted


def legs_apart(joints: Tensor, fixed: Tensor | None = None) -> Tensor:
    r"""How far to move the left foot out, and the right one as far, where legs close or cross.

    $$\tfrac12\,\operatorname{clip}\big(2 - d / g,\ 0,\ 1\big)
      \Big[\sqrt{[g^2 - a^2]_+} - s\Big]_+, \qquad
      s = (p_\text{left} - p_\text{right}) \cdot e$$

    d is the distance of the ankles and g 15 cm. e points from the right hip to the left one, along
    the floor; a is what of the distance is across e, so that a foot may pass by the other, and legs
    may cross with 30 cm between them. The largest lack within a quarter of a second
    counts and is smoothed over as much again: a foot that stands moves as a whole.

    Source: ours. The choreographer's dancers keep their ankles so far apart in 99 % of the frames;
    people close their legs in 4 % (docs/drift.md), which this rule forbids.

    Shapes: joints (..., f, j, 3) metres, fixed (..., f) bool -> (..., f, 3) metres.

    >>> joints = torch.zeros(40, 24, 3)
    >>> joints[:, 1, 0], joints[:, 2, 0] = 0.06, -0.06           # hips; the ankles touch
    >>> [round(x, 3) for x in legs_apart(joints)[20].tolist()]
    [0.075, 0.0, 0.0]
    """
    hips, ankles = joints[..., [1, 2], :], joints[..., FOOT_JOINTS[:2], :]
    out = (hips[..., 0, :] - hips[..., 1, :]) * joints.new_tensor([1.0, 0.0, 1.0])
    out = out / out.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    gap = ankles[..., 0, :] - ankles[..., 1, :]
    aside = (gap * out).sum(-1)
    across = (gap.square().sum(-1) - aside.square()).clamp_min(0)
    lack = ((APART**2 - across).clamp_min(0).sqrt() - aside).clamp_min(0)
    lack = lack * (2 - gap.norm(dim=-1) / APART).clamp(0, 1)
    rows = lack.reshape(-1, 1, lack.shape[-1])
    rows = max_pool1d(rows, QUARTER, 1, QUARTER // 2)
    rows = avg_pool1d(rows, QUARTER, 1, QUARTER // 2, count_include_pad=False)
    lack = rows.reshape(lack.shape)
    if fixed is not None:
        lack = lack.masked_fill(fixed, 0)
    return lack[..., None] * out / 2


def root_shift(u: Tensor, c: Tensor, rooted: Tensor | None = None) -> Tensor:
    r"""How far the root follows the feet that are moved, so that legs keep their bend.

    $$\min_v \sum_i \lVert v_i - \bar u_i \rVert^2 + S\,\lVert \Delta^2 v_i \rVert^2, \qquad
      \bar u_i = \frac{\sum_k (s_{ik} + \epsilon)\,u_{ik}}{\sum_k (s_{ik} + \epsilon)}$$

    s says how surely a foot stands: where one stands the root goes with it, where both do or
    none does, with both.

    Source: ours.

    Shapes: u (..., f, 2, 3) metres, left and right; c (..., f, 4), rooted (..., f, 3) bool
    -> (..., f, 3) metres.

    >>> u, c = torch.zeros(9, 2, 3), torch.tensor([1.0, 0.0, 1.0, 0.0]).expand(9, 4)
    >>> u[:, 0, 0] = 0.1                                           # the left foot stands
    >>> [round(x, 2) for x in root_shift(u, c)[0].tolist()]
    [0.1, 0.0, 0.0]
    """
    stands = c.double().unflatten(-1, (2, 2)).amax(-2)  # the ankle's contact or the toe's
    weight = ((stands - UNSURE) / (SURE - UNSURE)).clamp(0, 1) + NEITHER
    goal = (weight[..., None] * u.double()).sum(-2) / weight.sum(-1, keepdim=True)
    stay = torch.ones_like(goal)
    if rooted is not None:
        stay, goal = stay.masked_fill(rooted, FIXED), goal.masked_fill(rooted, 0)
    bend = SMOOTH * bends(u.shape[-3]).to(stay)
    v = [
        solve_banded(nearness(near) + bend, (near * to)[..., None])[..., 0]
        for near, to in zip(stay.unbind(-1), goal.unbind(-1), strict=True)
    ]
    shift = torch.stack(v, -1).to(u)
    return shift if rooted is None else shift.masked_fill(rooted, 0)


def support(c: Tensor, joints: Tensor) -> Tensor:
    r"""Contacts with a foot to stand on wherever a body does not leap.

    If no toe is planted although a foot is near the floor, one is called planted: the one with the
    larger $c_\text{toe} - y_\text{toe} / 10\,\text{cm}$ on average over five frames. A body whose
    feet both travel is carried by nothing, which is what `dancediff.metrics.physical.pfc` counts.

    Source: ours.

    Shapes: c (..., f, 4), joints (..., f, j, 3) metres -> (..., f, 4).

    >>> joints = torch.zeros(2, 24, 3)
    >>> joints[:, 11, 1] = 0.04                               # the right toe is higher
    >>> [round(c, 3) for c in support(torch.zeros(2, 4), joints)[0].tolist()]
    [0.0, 0.0, 0.7, 0.0]
    """
    toe, y = c[..., 2:], joints[..., FOOT_JOINTS, 1]
    score = toe.clamp(0, 1) - y[..., 2:] / REACH
    rows = score.reshape(-1, *score.shape[-2:]).mT
    mean = avg_pool1d(rows, WEIGHT_SHIFT, 1, WEIGHT_SHIFT // 2, count_include_pad=False)
    surest = one_hot(mean.mT.reshape(score.shape).argmax(-1), 2).bool()
    stands = (toe.amax(-1) < SURE) & (y.amin(-1) < TOE_CLEARANCE + AIR)
    leaps = flights(joints[..., 1].amin(-1) - TOE_CLEARANCE)
    for ahead in range(TAKE_OFF + 1):
        stands[..., : leaps.shape[-1] - ahead] &= ~leaps[..., ahead:]
    toe = torch.where(surest & stands[..., None], toe.clamp_min(SURE), toe)
    return torch.cat([c[..., :2], toe], -1)


def foot_contact_shift(p: Tensor, c: Tensor, fixed: Tensor | None = None) -> Tensor:
    r"""How far to move a foot in every frame so that it stands while it is planted.

    $$\min_u \sum_i \Big[\lVert u_i \rVert^2 + S\,\lVert \Delta^2 u_i \rVert^2
      + H \sum_j s_{ij}\,\lVert \Delta p_{ij} + \Delta u_i \rVert^2
      + H s_{i,\text{toe}}\,(p_{i,\text{toe}} + u_i - 2\,\text{cm})_y^2\Big], \qquad
      s_{ij} = \operatorname{clip}\frac{c_{ij} - 0.3}{0.4}$$

    A stance is moved as a whole to its middle and down to the floor, and in the air the shift
    passes smoothly from one stance to the next: a foot may not wait on the floor and then jump.
    Then feet below the floor are lifted onto it.

    Source: ours.

    Shapes: p (..., f, j, 3) metres, c (..., f, j), fixed (..., f) -> (..., f, 3) metres.

    >>> slides = torch.linspace(0, 0.1, 5)[:, None, None] * torch.tensor([1.0, 0.0, 0.0]) + 0.05
    >>> u = foot_contact_shift(slides, torch.ones(5, 1))
    >>> [round(x, 3) for x in (slides[:, 0] + u)[:, 0].tolist()]      # it stands in the middle
    [0.1, 0.1, 0.1, 0.1, 0.1]
    """
    f = p.shape[-3]
    stands = STAND * ((c.double() - UNSURE) / (SURE - UNSURE)).clamp(0, 1)
    w, toe = stands[..., :-1, :], stands[..., -1]
    step = p.double().diff(dim=-3)
    stay = torch.ones(p.shape[:-2], dtype=w.dtype, device=p.device)
    if fixed is not None:
        stay = stay.masked_fill(fixed, FIXED)
    A = steps(w.sum(-1)) + SMOOTH * bends(f).to(w) + nearness(stay)
    pull = (w[..., None] * step).sum(-2)  # each frame is pulled by the step to it and from it
    b = pad(pull, (0, 0, 0, 1)) - pad(pull, (0, 0, 1, 0))
    b_up = b[..., 1] + toe * (TOE_CLEARANCE - p[..., -1, 1].double())
    x, z = solve_banded(A, b[..., ON_FLOOR]).unbind(-1)
    y = solve_banded(A + nearness(toe), b_up[..., None])[..., 0]
    u = torch.stack([x, y, z], -1).to(p)
    lowest = p.new_tensor(LOWEST[: p.shape[-2]])
    lift = (lowest - p[..., 1] - u[..., None, 1]).amax(-1).clamp_min(0)
    if fixed is not None:
        lift = lift.masked_fill(fixed, 0)
    return u + lift[..., None] * u.new_tensor([0.0, 1.0, 0.0])


def _leg(hip: Tensor, knee: Tensor, ankle: Tensor, target: Tensor, Q: Tensor, leg: list) -> tuple:
    """Rotations of hip, knee and ankle on their parents that bring the ankle to ``target``.

    Thigh and shin are turned by the shortest way, so they keep their twist; the foot keeps its
    rotation in the world.
    """
    thigh, shin = (SMPL24.offsets[j].norm().item() for j in leg[1:3])
    front = STRAIGHT * Q[..., leg[0], :, 2]
    at, reached = two_bone_knee(hip, target, knee - hip + front, thigh, shin)
    Q_hip = rotation_between(knee - hip, at - hip) @ Q[..., leg[0], :, :]
    Q_knee = rotation_between(ankle - knee, reached - at) @ Q[..., leg[1], :, :]
    Q_ankle = Q[..., leg[2], :, :]
    return Q[..., 0, :, :].mT @ Q_hip, Q_hip.mT @ Q_knee, Q_knee.mT @ Q_ankle
