import torch

from dancediff.motion.ground import ground_height
from dancediff.motion.skeleton import SMPL24, forward_kinematics


def test_a_standing_dancer_stands_on_the_floor():
    root = torch.tensor([0.0, 0.9759, 0.0]).repeat(50, 1)
    joints = forward_kinematics(torch.eye(3).expand(50, 24, 3, 3), root, SMPL24)
    assert abs(ground_height(joints).item()) < 0.005
    assert torch.isclose(ground_height(joints + 0.5), ground_height(joints) + 0.5)


def test_one_bad_frame_does_not_move_the_floor():
    joints = torch.full((100, 24, 3), 0.02)
    joints[7] -= 1
    assert abs(ground_height(joints).item()) < 1e-6
