from dataclasses import replace

import pytest
import torch

from dancediff.motion.mirror import _PAIRS, mirror_features
from dancediff.motion.representation import LODGE, pack, unpack
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import SMPL24, forward_kinematics


def test_mirroring_is_exact_on_a_symmetric_skeleton():
    offsets = SMPL24.offsets.clone()
    flip = torch.tensor([-1.0, 1, 1])
    offsets[[0, 3, 6, 9, 12, 15], 0] = 0
    swap = list(range(24))
    for a, b in _PAIRS:
        offsets[b] = offsets[a] * flip
        swap[a], swap[b] = b, a
    skeleton = replace(SMPL24, offsets=offsets)
    generator = torch.Generator().manual_seed(0)
    pose = axis_angle_to_matrix(torch.randn(20, 24, 3, generator=generator))
    root = torch.randn(20, 3, generator=generator)
    joints = forward_kinematics(pose, root, skeleton)
    _, root_m, pose_m = unpack(mirror_features(pack(torch.zeros(20, 4), root, pose)))
    mirrored = forward_kinematics(pose_m, root_m, skeleton)
    assert torch.allclose(mirrored, (joints * flip)[:, swap], atol=1e-5)


def test_left_and_right_contacts_change_places():
    x = torch.zeros(151)
    x[0] = 1
    assert mirror_features(x)[:4].tolist() == [0, 1, 0, 0]


def test_without_hands_everything_else_is_mirrored_alike():
    generator = torch.Generator().manual_seed(0)
    pose = axis_angle_to_matrix(torch.randn(5, 24, 3, generator=generator))
    x = pack(torch.rand(5, 4, generator=generator), torch.randn(5, 3, generator=generator), pose)
    short = x[:, : LODGE.dim]
    assert torch.equal(mirror_features(short, LODGE), mirror_features(x)[:, : LODGE.dim])
    with pytest.raises(ValueError, match="139 features a frame; tcdiffpp needs 151"):
        mirror_features(short)
