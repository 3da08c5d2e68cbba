r"""Rotations from joint positions: what forward kinematics did, undone.

Read first: `dancediff.motion.skeleton` · `dancediff.motion.ik`.

Positions say where bones point, not how they are turned about themselves. A joint with several
children is turned as they are. A knee or an elbow is a hinge, which tells how the limb above it is
turned; where the limb is straight, and for all other joints, no turn about the bone is added.

Symbols (axes: n dancers · f frames · j joints)
    p    positions, metres, y up                            (n, f, j, 3)
    Q    rotations of the joints in the world               (n, f, j, 3, 3)
    o    offsets of the joints from their parents at rest   (j, 3)
    s    length of the skeleton's legs over the dancers' mean
"""

import torch
from torch import Tensor

from dancediff.motion.ik import align_bone
from dancediff.motion.rotation import rotation_between
from dancediff.motion.skeleton import SMPL24

SHORTEST_BONE = 1e-4  # metres: a shorter bone points nowhere
OPPOSITE = -0.99  # cosine from which on there is no shortest rotation worth the name
STRAIGHT = 0.05  # sine of the bend at which hinge and no turn count alike
HINGES = {  # upper joint: its axis at rest, about which the lower bone bends
    "lhip": (1.0, 0.0, 0.0), "rhip": (1.0, 0.0, 0.0),
    "lshoulder": (0.0, -1.0, 0.0), "rshoulder": (0.0, 1.0, 0.0),
}  # fmt: skip
_LEGS = [(a, b) for s in "lr" for a, b in ((f"{s}hip", f"{s}knee"), (f"{s}knee", f"{s}ankle"))]


def fit_rotations(points: Tensor) -> tuple[Tensor, Tensor]:
    r"""Pose and root path of SMPL-24 bodies whose bones point where those of ``points`` do.

    With one child c, $Q_j\,o_c \parallel p_c - p_j$. With several, $Q_j$ is the rotation for which
    $\sum_c |Q_j\,o_c - (p_c - p_j)|^2$ is least. The root path is $s\,p_0$, so that dancers whose
    legs are longer or shorter keep their feet on the floor; one s holds for all of them.

    Source: the least squares by a singular value decomposition are those of Kabsch (1976).

    Shapes: points (n, f, 24, 3) metres, y up -> pose (n, f, 24, 3, 3), root (n, f, 3).
    Raises: ValueError for another shape, numbers that are not finite, or a bone without length.

    >>> from dancediff.motion.skeleton import forward_kinematics
    >>> rest = forward_kinematics(torch.eye(3).expand(1, 2, 24, 3, 3), torch.ones(1, 2, 3))
    >>> torch.allclose(forward_kinematics(*fit_rotations(rest)), rest, atol=1e-5)
    True
    """
    points = _checked(points)
    bone = {j: points[:, :, j] - points[:, :, p] for p, j in SMPL24.bones}
    offset, at = SMPL24.offsets.double(), SMPL24.index
    hinges = {at(name): offset.new_tensor(axis) for name, axis in HINGES.items()}
    start = torch.eye(3, dtype=torch.float64).expand(*points.shape[:2], 3, 3)
    Q: list[Tensor] = []
    for j, parent in enumerate(SMPL24.parents):
        before = start if parent < 0 else Q[parent]
        children = [c for p, c in SMPL24.bones if p == j]
        if not children:
            Q.append(before)
        elif len(children) > 1:
            Q.append(_turn_of(offset[children], torch.stack([bone[c] for c in children], -2)))
        else:
            c = children[0]
            swing = _swing(before @ offset[c], bone[c]) @ before
            if j in hinges:
                (below,) = [k for p, k in SMPL24.bones if p == c]
                axis = _hinge(bone[c], bone[below], swing @ hinges[j])
                swing = align_bone(offset[c], hinges[j], bone[c], axis)
            Q.append(swing)
    local = [q if p < 0 else Q[p].mT @ q for q, p in zip(Q, SMPL24.parents, strict=True)]
    legs = [(offset[at(b)].norm(), bone[at(b)].norm(dim=-1).mean()) for _, b in _LEGS]
    s = sum(ours for ours, _ in legs) / sum(theirs for _, theirs in legs)
    return torch.stack(local, 2).float(), (s * points[:, :, 0]).float()


def _checked(points: Tensor) -> Tensor:
    points = torch.as_tensor(points).detach().cpu().double()
    if points.ndim != 4 or points.shape[2:] != (SMPL24.num_joints, 3) or 0 in points.shape:
        raise ValueError(
            f"points has shape {tuple(points.shape)}; expected (n, f, 24, 3): positions of the "
            "joints of dancediff.motion.skeleton.SMPL24, in its order"
        )
    if not points.isfinite().all():
        raise ValueError("points has numbers that are not finite; leave those frames out")
    for p, j in SMPL24.bones:
        length = (points[:, :, j] - points[:, :, p]).norm(dim=-1)
        if length.min() < SHORTEST_BONE:
            k, f = divmod(int(length.argmin()), points.shape[1])
            raise ValueError(
                f"points of dancer {k}, frame {f}: {SMPL24.names[p]} and {SMPL24.names[j]} are in "
                "one place, so their bone points nowhere; leave the frame out"
            )
    return points


def _turn_of(rest: Tensor, bones: Tensor) -> Tensor:
    """The rotation that brings offsets (c, 3) nearest to bones (n, f, c, 3)."""
    U, _, V = torch.linalg.svd(bones.mT @ rest)
    flip = torch.ones_like(U[..., 0])
    flip[..., 2] = torch.linalg.det(U @ V)  # a mirrored body is no turned one
    return U * flip[..., None, :] @ V


def _swing(a: Tensor, b: Tensor) -> Tensor:
    """The shortest rotation from a to b, (n, f, 3) each; half a turn where they are opposite."""
    least = torch.nn.functional.one_hot(a.abs().argmin(-1), 3).to(a)  # an axis far from a
    k = torch.nn.functional.normalize(torch.linalg.cross(a, least), dim=-1)
    half = 2 * k[..., None] * k[..., None, :] - torch.eye(3, dtype=a.dtype)
    opposite = (torch.nn.functional.cosine_similarity(a, b, dim=-1) < OPPOSITE)[..., None, None]
    return torch.where(opposite, rotation_between(-a, b) @ half, rotation_between(a, b))


def _hinge(upper: Tensor, lower: Tensor, swung: Tensor) -> Tensor:
    """The axis of a knee or an elbow: square to both bones, or where they are in line, as swung."""
    unit = torch.nn.functional.normalize
    across = torch.linalg.cross(unit(upper, dim=-1), unit(lower, dim=-1))
    bend = across.norm(dim=-1, keepdim=True)  # its sine
    across = across * (bend / (bend + STRAIGHT))
    return across + swung * (STRAIGHT * STRAIGHT / (bend + STRAIGHT))
