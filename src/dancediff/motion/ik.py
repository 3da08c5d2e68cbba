r"""Two-bone inverse kinematics: bend a knee so that the ankle reaches a point.

Symbols
    hip, target  positions, metres              (..., 3)
    pole         direction the knee points to   (..., 3)
    l1, l2       length of thigh and shin, metres
"""

import torch
from torch import Tensor

EPS = 1e-6


def two_bone_knee(hip: Tensor, target: Tensor, pole: Tensor, l1: float, l2: float):
    r"""Place the knee by the law of cosines.

    $$\cos\alpha = \frac{l_1^2 + r^2 - l_2^2}{2\,l_1 r},\quad
      \text{knee} = \text{hip} + l_1(\cos\alpha\,\hat r + \sin\alpha\,\hat p_\perp)$$

    where r points from hip to target and $p_\perp$ is the part of ``pole`` square to it. A target
    out of reach is pulled in to 99.9 % of the leg's length.

    Shapes: hip, target, pole (..., 3) -> knee (..., 3), reached target (..., 3); metres.

    >>> hip, foot, front = torch.tensor([[0.0, 1, 0], [0, 0, 0], [0, 0, 1]])
    >>> knee, reached = two_bone_knee(hip, foot, front, 0.6, 0.6)
    >>> round((knee - hip).norm().item(), 4), round((reached - knee).norm().item(), 4)
    (0.6, 0.6)
    """
    line = target - hip
    dist = line.norm(dim=-1, keepdim=True)
    unit = line / dist.clamp_min(EPS)
    r = dist.clamp(abs(l1 - l2) * 1.001 + EPS, (l1 + l2) * 0.999)
    side = pole - (pole * unit).sum(-1, keepdim=True) * unit
    side = torch.nn.functional.normalize(side, dim=-1)
    cos = ((l1**2 + r**2 - l2**2) / (2 * l1 * r)).clamp(-1, 1)
    knee = hip + l1 * (cos * unit + (1 - cos**2).sqrt() * side)
    return knee, hip + r * unit


def frame_from_bone(bone: Tensor, axis: Tensor) -> Tensor:
    r"""Orthonormal frame with its first column along ``bone`` and the second close to ``axis``.

    Shapes: bone, axis (..., 3) -> (..., 3, 3).

    >>> frame_from_bone(torch.tensor([2.0, 0, 0]), torch.tensor([0.0, 1, 0])).equal(torch.eye(3))
    True
    """
    a = torch.nn.functional.normalize(bone, dim=-1)
    b = torch.nn.functional.normalize(axis - (axis * a).sum(-1, keepdim=True) * a, dim=-1)
    return torch.stack([a, b, torch.linalg.cross(a, b)], dim=-1)


def align_bone(rest: Tensor, rest_axis: Tensor, bone: Tensor, axis: Tensor) -> Tensor:
    r"""Rotation that carries a rest bone onto ``bone`` and its hinge axis onto ``axis``.

    Shapes: rest, rest_axis (3,); bone, axis (..., 3) -> (..., 3, 3) world rotation.

    >>> R = align_bone(*torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1], [1, 0, 0]]))
    >>> torch.allclose(R @ torch.tensor([0.0, -1, 0]), torch.tensor([0.0, 0, 1]), atol=1e-6)
    True
    """
    return frame_from_bone(bone, axis) @ frame_from_bone(rest, rest_axis).mT


def two_bone_ik(hip: Tensor, target: Tensor, pole: Tensor, rest_thigh: Tensor, rest_shin: Tensor):
    r"""World rotations of thigh and shin that bring the ankle to ``target``.

    The knee bends in the plane of hip, target and ``pole`` (see `two_bone_knee`).

    Shapes: hip, target, pole (..., 3); rest_thigh, rest_shin (3,) rest offsets of knee and ankle
    -> thigh (..., 3, 3), shin (..., 3, 3) world rotations, reached ankle (..., 3).

    >>> hip, foot, front = torch.tensor([[0.0, 0.8, 0], [0.1, 0, 0.2], [0, 0, 1]])
    >>> bone = torch.tensor([0.0, -0.45, 0])
    >>> thigh, shin, reached = two_bone_ik(hip, foot, front, bone, bone)
    >>> torch.allclose(hip + thigh @ bone + shin @ bone, foot, atol=1e-5)
    True
    """
    l1, l2 = rest_thigh.norm().item(), rest_shin.norm().item()
    knee, reached = two_bone_knee(hip, target, pole, l1, l2)
    # the hinge is square to the leg's plane; at rest it is the body's x axis (left)
    line = reached - hip
    hinge = torch.nn.functional.normalize(torch.linalg.cross(line, -pole), dim=-1)
    left = rest_thigh.new_tensor([1.0, 0.0, 0.0])
    thigh = align_bone(rest_thigh, left, knee - hip, hinge)
    shin = align_bone(rest_shin, left, reached - knee, hinge)
    return thigh, shin, reached
