import pytest
import torch

from dancediff.motion.rotation import (
    axis_angle_to_matrix,
    matrix_to_axis_angle,
    matrix_to_rot6d,
    rot6d_to_matrix,
    rotation_about,
    rotation_angle,
    rotation_between,
)


def random_rotations(*shape):
    return axis_angle_to_matrix(torch.randn(*shape, 3, generator=torch.Generator().manual_seed(0)))


def test_identity_is_1_0_0_0_1_0():
    assert matrix_to_rot6d(torch.eye(3)).tolist() == [1, 0, 0, 0, 1, 0]


def test_round_trip_of_random_rotations():
    R = random_rotations(500)
    assert torch.allclose(rot6d_to_matrix(matrix_to_rot6d(R)), R, atol=1e-6)


def test_rows_not_columns():
    """Knee flexion (+x rotation) shows up as R12 = -sin in the sixth number."""
    R = rotation_about("x", torch.tensor(0.5))
    assert torch.isclose(matrix_to_rot6d(R)[5], -torch.sin(torch.tensor(0.5)))
    assert not torch.allclose(matrix_to_rot6d(R), matrix_to_rot6d(R.mT))


def test_any_six_numbers_decode_to_a_rotation_with_finite_gradient():
    d6 = torch.randn(200, 6, generator=torch.Generator().manual_seed(1), requires_grad=True)
    R = rot6d_to_matrix(d6)
    assert torch.allclose(R @ R.mT, torch.eye(3).expand(200, 3, 3), atol=1e-5)
    assert torch.allclose(torch.linalg.det(R), torch.ones(200), atol=1e-5)
    R.square().sum().backward()
    assert d6.grad.isfinite().all()


def test_axis_angle_round_trip():
    R = random_rotations(50)
    assert torch.allclose(axis_angle_to_matrix(matrix_to_axis_angle(R)), R, atol=1e-5)


def test_the_angle_is_the_length_of_the_axis_angle_vector():
    R = random_rotations(500).double()
    lengths = matrix_to_axis_angle(R).norm(dim=-1)
    assert torch.allclose(rotation_angle(R), lengths, atol=1e-3)
    assert rotation_angle(torch.diag(torch.tensor([1.0, -1.0, -1.0]))) == torch.pi


def test_rotation_between_carries_a_to_b():
    a, b = torch.randn(2, 100, 3, generator=torch.Generator().manual_seed(2))
    turned = (rotation_between(a, b) @ a[..., None])[..., 0]
    assert torch.allclose(
        turned / turned.norm(dim=-1, keepdim=True), b / b.norm(dim=-1, keepdim=True), atol=1e-4
    )


def test_unknown_axis_is_named():
    with pytest.raises(ValueError, match="axis='w'"):
        rotation_about("w", torch.tensor(1.0))
