"""Plausible wrong answers to the exercises of lesson 01: A dance is a tensor."""

import torch

from dancediff.motion.rotation import rot6d_to_matrix, rotation_about
from dancediff.motion.skeleton import world_rotations


def arm_up(turn, straight=True):
    """Raise the left arm: ``turn`` of the pose is the new rotation of the shoulder."""

    def answer(pose):
        pose = pose.clone()
        if straight:
            pose[[18, 20]] = torch.eye(3)
        pose[16] = turn(pose)
        return pose

    return answer


def quarter(sign=1):
    return rotation_about("z", torch.tensor(sign * torch.pi / 2))


def stand_up_first(pose):
    pose = pose.clone()
    pose[:16] = torch.eye(3)
    return arm_up(lambda _: quarter())(pose)


def six_as_columns(d6):
    return rot6d_to_matrix(d6).mT


def six_not_squared(d6):
    a, b = (torch.nn.functional.normalize(v, dim=-1) for v in (d6[..., :3], d6[..., 3:]))
    return torch.stack([a, b, torch.linalg.cross(a, b)], dim=-2)


def six_left_handed(d6):
    R = rot6d_to_matrix(d6)
    return torch.cat([R[..., :2, :], -R[..., 2:, :]], dim=-2)


def six_changes_nothing(d6):
    return torch.eye(3).expand(*d6.shape[:-1], 3, 3)


NEAR_MISSES = {
    "01.1": [
        {"18 left elbow": 3, "22 left hand": 1, "9 chest": 13, "0 root": 24},  # the joint itself
        {"18 left elbow": 2, "22 left hand": 0, "9 chest": 3, "0 root": 3},  # children only
        {"18 left elbow": 2, "22 left hand": 0, "9 chest": 12, "0 root": 0},
        {"18 left elbow": 21, "22 left hand": 23, "9 chest": 11, "0 root": 0},  # what stays
    ],
    "01.2": [
        arm_up(lambda pose: quarter()),  # leans with the body
        arm_up(lambda pose: quarter() @ world_rotations(pose)[13].mT),  # the wrong way round
        arm_up(lambda pose: world_rotations(pose)[16].mT @ quarter()),  # minds its own turn, too
        arm_up(lambda pose: world_rotations(pose)[13].mT @ quarter(-1)),  # down
        arm_up(lambda pose: world_rotations(pose)[13].mT @ quarter(), straight=False),
        arm_up(lambda pose: world_rotations(pose)[13] @ quarter()),  # no inverse
        arm_up(lambda pose: torch.zeros(3, 3)),
        stand_up_first,
        lambda pose: pose,
        lambda pose: pose.new_tensor(quarter()).expand(24, 3, 3).clone(),  # all joints
        arm_up(lambda pose: 1.2 * world_rotations(pose)[13].mT @ quarter()),  # longer bones
    ],
    "01.3": [
        six_as_columns,
        six_not_squared,
        six_left_handed,
        six_changes_nothing,
        lambda d6: rot6d_to_matrix(d6.flip(-1)),  # the rows exchanged, and backwards
        lambda d6: rot6d_to_matrix(d6.unflatten(-1, (3, 2)).transpose(-1, -2).flatten(-2)),
        lambda d6: rot6d_to_matrix(d6)[..., :2, :],  # no third row
    ],
    "01.4": [
        lambda: ([1.0, 0, 0, 0, 1, 0], [1.0, 0, 0, 0, 1.01, 0]),  # rows at right angles
        lambda: ([1.0, 0, 0, 1, 0, 0], [1.0, 0, 0, 1, 0.01, 0]),  # parallel
        lambda: ([1.0, 0, 0, 0, 0.004, 0], [1.0, 0, 0, 0, -0.004, 0]),  # too short
        lambda: ([1.0, 0, 0, 1, 0.1, 0], [1.0, 0, 0, 1, -0.1, 0]),  # too far apart
        lambda: ([1.0, 0, 0, 0, 1, 0], [-1.0, 0, 0, 0, 1, 0]),
        lambda: [1.0, 0, 0, 1, 0.004, 0],  # one only
    ],
}
