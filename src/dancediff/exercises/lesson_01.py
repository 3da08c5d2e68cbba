"""Exercises of lesson 01: A dance is a tensor."""

import torch

from dancediff.motion.rotation import (
    axis_angle_to_matrix,
    matrix_to_rot6d,
    rot6d_to_matrix,
    rotation_about,
)
from dancediff.motion.skeleton import SMPL24, forward_kinematics, world_rotations

LEFT_ARM = [SMPL24.index(name) for name in ("lshoulder", "lelbow", "lwrist")]


def _raise_hand(pose):
    pose = pose.clone()
    pose[LEFT_ARM] = torch.eye(3)
    collar = world_rotations(pose)[SMPL24.index("lcollar")]
    pose[LEFT_ARM[0]] = collar.mT @ rotation_about("z", torch.tensor(torch.pi / 2))
    return pose


def _poses() -> list[tuple]:
    turns = 0.5 * torch.randn(3, 24, 3, generator=torch.Generator().manual_seed(2))
    turns[0, 0] = torch.tensor([0.0, 0.0, 1.6])  # lies on the side
    turns[1, 0] = torch.tensor([1.2, 0.0, 0.0])  # bows
    return [(pose,) for pose in axis_angle_to_matrix(turns)]


def _raised(got, pose) -> str:
    if tuple(got.shape) != (24, 3, 3):
        return f"shape {tuple(got.shape)}, expected (24, 3, 3)"
    if not _are_rotations(got):
        return "some of your matrices are no rotations: they bend the bones"
    others = [j for j in range(24) if j not in LEFT_ARM]
    if not torch.allclose(got[others], pose[others], atol=1e-4):
        return "you have turned other joints, too; expected only 16, 18 and 20"
    joints = forward_kinematics(got, torch.zeros(3))
    up = (joints[SMPL24.index("lhand")] - joints[LEFT_ARM[0]])[1].item()
    return "" if up >= 0.55 else f"the hand is {up:.2f} m above its shoulder, expected 0.55 or more"


def _are_rotations(R) -> bool:
    square = torch.allclose(R @ R.mT, torch.eye(3).expand_as(R), atol=1e-3)
    return square and bool((torch.linalg.det(R) > 0).all())


def _rotation_cases() -> list[tuple]:
    R = axis_angle_to_matrix(torch.tensor([[0.3, -1.1, 0.4], [0.0, 2.0, 1.0]]))
    d6 = matrix_to_rot6d(R)
    stretched = d6 * torch.tensor([2.0, 2, 2, 0.5, 0.5, 0.5])
    bent = stretched + 0.3 * stretched[..., [3, 4, 5, 0, 1, 2]]  # the rows are no longer square
    return [(d6,), (stretched,), (bent,)]


def _two_near():
    return [1.0, 0, 0, 1, 0.004, 0], [1.0, 0, 0, 1, -0.004, 0]


def _jumps(got) -> str:
    pair = torch.stack([torch.as_tensor(d6).float().reshape(6) for d6 in got])
    if len(pair) != 2:
        return f"{len(pair)} answers, expected two"
    if pair.unflatten(-1, (2, 3)).norm(dim=-1).min() < 1:
        return "one of your rows is shorter, expected a length of 1 or more"
    if (apart := (pair[0] - pair[1]).abs().max().item()) > 0.0101:
        return f"yours differ by {apart:.3g}, expected at most 0.01"
    R = rot6d_to_matrix(pair)
    if not _are_rotations(R):
        return "one of yours is no rotation at all: its rows are parallel, not nearly parallel"
    angle = torch.rad2deg(torch.acos(((torch.trace(R[0].mT @ R[1]) - 1) / 2).clamp(-1, 1))).item()
    return "" if angle >= 90 else f"your rotations are {angle:.0f} degrees apart, expected 90"


def _resample(x, old, new):
    from dancediff.data.resample import resample_motion
    from dancediff.motion.motion import Motion

    return resample_motion(Motion.from_features(x, fps=old), new).features()


def _at_rates() -> list[tuple]:
    """Bodies that turn by up to 100 degrees a frame; the last frame is met or not."""
    draw = torch.Generator().manual_seed(5)
    cases = []
    for n, f, old, new in ((2, 9, 60, 24), (1, 7, 24, 30), (3, 12, 100, 30), (2, 11, 120, 30)):
        turns = axis_angle_to_matrix(torch.randn(n, f, 24, 3, generator=draw).clamp(-1, 1))
        pose = [turns[:, 0]]
        for turn in turns[:, 1:].unbind(1):
            pose.append(pose[-1] @ turn)
        d6 = matrix_to_rot6d(torch.stack(pose, dim=1)).flatten(-2)
        contact = torch.randint(2, (n, f, 4), generator=draw).float()
        root = torch.randn(n, f, 3, generator=draw)
        cases.append((torch.cat([contact, root, d6], dim=-1), old, new))
    return cases


SPECS = {
    "01.2": {"spec": _raise_hand, "cases": _poses, "accepts": _raised},
    "01.3": {"spec": rot6d_to_matrix, "cases": _rotation_cases},
    "01.4": {"spec": _two_near, "accepts": _jumps},
    "01.5": {"spec": _resample, "cases": _at_rates},
}
