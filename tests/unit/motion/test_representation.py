import pytest
import torch

from dancediff.motion.representation import (
    LODGE,
    TCDIFFPP,
    Normalizer,
    joints_of,
    pack,
    spec_named,
    unpack,
    whole_pose,
)
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import SMPL24


def test_slices_cover_151_channels_once():
    taken = [*range(151)[TCDIFFPP.contact], *range(151)[TCDIFFPP.root], *range(151)[TCDIFFPP.rot6d]]
    assert taken == list(range(151)) and TCDIFFPP.dim == 151


def test_joint_channels_name_the_right_rotation():
    pose = torch.eye(3).repeat(24, 1, 1)
    pose[4] = axis_angle_to_matrix(torch.tensor([0.3, -0.5, 0.7]))  # changes all six numbers
    x = pack(torch.zeros(4), torch.zeros(3), pose)
    changed = (x != pack(torch.zeros(4), torch.zeros(3), torch.eye(3).repeat(24, 1, 1))).nonzero()
    assert changed[:, 0].tolist() == TCDIFFPP.joint_channels([4])


def test_pack_and_unpack_are_inverse():
    pose = axis_angle_to_matrix(torch.randn(3, 24, 3, generator=torch.Generator().manual_seed(0)))
    parts = (torch.rand(3, 4), torch.randn(3, 3), pose)
    for before, after in zip(parts, unpack(pack(*parts)), strict=True):
        assert torch.allclose(before, after, atol=1e-6)


def test_wrong_width_is_named():
    with pytest.raises(ValueError, match="139"):
        unpack(torch.zeros(2, 139))


def test_normalizer_maps_the_training_range_to_minus_one_one():
    x = torch.randn(7, 50, 151, generator=torch.Generator().manual_seed(0)) * 3 + 1
    x[..., 9] = 4.2  # a constant channel
    norm = Normalizer.fit(x)
    y = norm.normalize(x)
    moving = [k for k in range(151) if k != 9]
    assert torch.allclose(y[..., moving].amin((0, 1)), -torch.ones(150), atol=1e-5)
    assert torch.allclose(y[..., moving].amax((0, 1)), torch.ones(150), atol=1e-5)
    assert torch.allclose(norm.unnormalize(y), x, atol=1e-4)


def test_normalizer_is_fitted_once_not_per_clip():
    """The released TCDiff++ refits it per clip, so two clips a metre apart look the same."""
    near, far = torch.zeros(10, 151), torch.ones(10, 151)
    norm = Normalizer.fit(torch.stack([near, far]))
    assert not torch.allclose(norm.normalize(near), norm.normalize(far))


def test_normalizer_is_saved_with_a_model():
    assert set(Normalizer(torch.zeros(3), torch.ones(3)).state_dict()) == {"low", "high"}


def test_slices_of_lodge_cover_139_channels_once():
    taken = [*range(139)[LODGE.contact], *range(139)[LODGE.root], *range(139)[LODGE.rot6d]]
    assert taken == list(range(139)) and LODGE.dim == 139


def test_the_joints_that_lodge_leaves_out_are_the_hands():
    assert SMPL24.names[LODGE.num_joints :] == ("lhand", "rhand")
    pose = axis_angle_to_matrix(torch.randn(3, 24, 3, generator=torch.Generator().manual_seed(0)))
    x = pack(torch.zeros(3, 4), torch.randn(3, 3), pose)
    short = x[:, : LODGE.dim]
    assert torch.equal(joints_of(short, LODGE), joints_of(x))  # hands end a chain
    assert torch.equal(whole_pose(unpack(short, LODGE)[2])[:, 22:], torch.eye(3).expand(3, 2, 3, 3))


def test_unknown_vectors_are_named():
    with pytest.raises(ValueError, match=r"'edge'.*'tcdiffpp', 'lodge'"):
        spec_named("edge")
    with pytest.raises(ValueError, match=r"151 features.*lodge"):
        unpack(torch.zeros(2, 151), LODGE)


def test_a_normaliser_is_not_fitted_to_what_is_broken():
    for x in (torch.zeros(0, 151), torch.tensor([[0.0, float("nan")]])):
        with pytest.raises(ValueError, match=r"x \(.* no row, or NaN"):
            Normalizer.fit(x)
