import numpy as np
import pytest
import torch

from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import SMPL24, forward_kinematics, world_rotations


def test_t_pose_heights():
    """paper-notes 1.1: ankles, toes and head of the rest pose relative to the root."""
    joints = forward_kinematics(torch.eye(3).expand(24, 3, 3), torch.zeros(3))
    height = dict(zip(SMPL24.names, joints[:, 1].tolist(), strict=True))
    assert height["lankle"] == pytest.approx(-0.8956, abs=1e-4)
    assert height["rankle"] == pytest.approx(-0.8942, abs=1e-4)
    assert height["ltoe"] == pytest.approx(-0.9559, abs=1e-4)
    assert height["rtoe"] == pytest.approx(-0.9564, abs=1e-4)
    assert height["head"] == pytest.approx(0.6190, abs=1e-4)


def test_agrees_with_homogeneous_matrices():
    """A second implementation: chains of 4 x 4 matrices in float64 numpy."""
    generator = torch.Generator().manual_seed(0)
    pose = axis_angle_to_matrix(torch.randn(24, 3, generator=generator))
    root = torch.randn(3, generator=generator)
    world = []
    for j, p in enumerate(SMPL24.parents):
        local = np.eye(4)
        local[:3, :3] = pose[j]
        local[:3, 3] = root if p < 0 else SMPL24.offsets[j]
        world.append(local if p < 0 else world[p] @ local)
    expected = np.stack([w[:3, 3] for w in world])
    assert np.allclose(forward_kinematics(pose, root), expected, atol=1e-5)
    turned = np.stack([w[:3, :3] for w in world])
    assert np.allclose(world_rotations(pose), turned, atol=1e-5)


def test_moving_the_root_moves_everything():
    pose = axis_angle_to_matrix(torch.randn(5, 24, 3, generator=torch.Generator().manual_seed(1)))
    shift = torch.tensor([1.0, -2.0, 0.5])
    here = forward_kinematics(pose, torch.zeros(5, 3))
    assert torch.allclose(forward_kinematics(pose, shift.expand(5, 3)), here + shift, atol=1e-5)


def test_bones_keep_their_length():
    pose = axis_angle_to_matrix(torch.randn(9, 24, 3, generator=torch.Generator().manual_seed(2)))
    joints = forward_kinematics(pose, torch.zeros(9, 3))
    for p, j in SMPL24.bones:
        length = (joints[:, j] - joints[:, p]).norm(dim=-1)
        assert torch.allclose(length, SMPL24.offsets[j].norm().expand(9), atol=1e-5)


def test_unknown_joint_is_named():
    with pytest.raises(ValueError, match="'tail'"):
        SMPL24.index("tail")
