"""Rotations of every kind: there and back, always orthonormal, mirrored twice the same."""

import math

import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE, TCDIFFPP
from dancediff.motion.rotation import (
    axis_angle_to_matrix,
    matrix_to_axis_angle,
    matrix_to_rot6d,
    rot6d_to_matrix,
    rotation_about,
    rotation_between,
    slerp,
)

often = settings(deadline=None, derandomize=True, max_examples=80)
seeds = st.integers(0, 2**32 - 1)
angles = st.floats(0, math.pi)


def normal(seed, *shape, dtype=torch.float64):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def axes(seed, count=20):
    return torch.nn.functional.normalize(normal(seed, count, 3), dim=-1)


def rotations(seed, count=20):
    return rot6d_to_matrix(normal(seed, count, 6))


def check_rotation(R, atol):
    eye = torch.eye(3, dtype=R.dtype).expand_as(R)
    torch.testing.assert_close(R @ R.mT, eye, atol=atol, rtol=0)
    torch.testing.assert_close(
        torch.linalg.det(R), torch.ones_like(R[..., 0, 0]), atol=atol, rtol=0
    )


@often
@given(seeds, st.floats(-6, 6), st.floats(-6, 6))
def test_six_numbers_of_any_size_are_a_rotation(seed, first, second):
    scale = torch.tensor([10.0**first] * 3 + [10.0**second] * 3, dtype=torch.float64)
    check_rotation(rot6d_to_matrix(normal(seed, 20, 6) * scale), 1e-9)


@often
@given(seeds, st.floats(1e-3, 1), st.floats(-50, 50))
def test_rows_that_are_nearly_parallel_are_a_rotation(seed, apart, times):
    a1, a2 = axes(seed), axes(seed + 1)
    a2 = torch.nn.functional.normalize(a2 - (a1 * a2).sum(-1, keepdim=True) * a1, dim=-1)
    d6 = torch.cat([a1, times * a1 + apart * a2], -1)
    check_rotation(rot6d_to_matrix(d6), 1e-9)
    check_rotation(rot6d_to_matrix(d6.float()), 2e-6 * (1 + abs(times) / apart))


@often
@given(seeds, st.floats(1e-3, 1e3), st.floats(1e-3, 1e3), st.floats(-10, 10))
def test_what_gram_schmidt_takes_off_does_not_matter(seed, long, wide, lean):
    R = rotations(seed)
    d6 = torch.cat([long * R[:, 0], wide * R[:, 1] + lean * wide * R[:, 0]], -1)
    torch.testing.assert_close(rot6d_to_matrix(d6), R, atol=1e-9, rtol=0)


@often
@given(seeds)
def test_6d_and_back(seed):
    R = rotations(seed)
    torch.testing.assert_close(rot6d_to_matrix(matrix_to_rot6d(R)), R, atol=1e-12, rtol=0)
    R = R.float()
    torch.testing.assert_close(rot6d_to_matrix(matrix_to_rot6d(R)), R, atol=1e-6, rtol=0)


@often
@given(seeds, angles)
def test_axis_angle_and_back(seed, angle):
    v = angle * axes(seed)
    R = axis_angle_to_matrix(v)
    check_rotation(R, 1e-11)
    trace = R.diagonal(dim1=-2, dim2=-1).sum(-1)
    torch.testing.assert_close(trace, torch.full_like(trace, 1 + 2 * math.cos(angle)))
    torch.testing.assert_close((R @ v[..., None])[..., 0], v, atol=1e-12, rtol=0)  # its own axis
    back = matrix_to_axis_angle(R)
    assert (back.norm(dim=-1) <= math.pi + 1e-9).all()
    torch.testing.assert_close(axis_angle_to_matrix(back), R, atol=1e-9, rtol=0)
    if angle < math.pi - 1e-3:  # at a half turn v and -v are the same
        torch.testing.assert_close(back, v, atol=1e-9, rtol=0)


@often
@given(seeds, angles)
def test_axis_angle_and_back_in_float32(seed, angle):
    R = axis_angle_to_matrix((angle * axes(seed)).float())
    check_rotation(R, 2e-6)
    torch.testing.assert_close(axis_angle_to_matrix(matrix_to_axis_angle(R)), R, atol=5e-6, rtol=0)


@often
@given(st.sampled_from("xyz"), st.floats(-10, 10), st.floats(-10, 10))
def test_turns_about_one_axis_add_up(axis, a, b):
    a, b = (torch.tensor(x, dtype=torch.float64) for x in (a, b))
    both = rotation_about(axis, a) @ rotation_about(axis, b)
    torch.testing.assert_close(both, rotation_about(axis, a + b), atol=1e-12, rtol=0)
    k = "xyz".index(axis)
    assert both[k, k] == pytest.approx(1)


@often
@given(seeds, st.floats(0.01, 100), st.floats(0.01, 100))
def test_rotation_between_is_the_shortest(seed, long, wide):
    a, b = axes(seed), axes(seed + 1)
    cos = (a * b).sum(-1)
    assume(cos.min() > -0.999)
    R = rotation_between(long * a, wide * b)
    check_rotation(R, 1e-9)
    torch.testing.assert_close((R @ a[..., None])[..., 0], b, atol=1e-9, rtol=0)
    angle = matrix_to_axis_angle(R).norm(dim=-1)
    torch.testing.assert_close(angle, torch.acos(cos.clamp(-1, 1)), atol=1e-6, rtol=0)


@often
@given(seeds, st.floats(0, 1))
def test_slerp_turns_evenly(seed, w):
    R0, R1 = rotations(seed), rotations(seed + 1)
    whole = matrix_to_axis_angle(R0.mT @ R1).norm(dim=-1)
    assume(whole.max() < math.pi - 1e-3)
    R = slerp(R0, R1, torch.full((len(R0),), w, dtype=torch.float64))
    check_rotation(R, 1e-9)
    torch.testing.assert_close(
        matrix_to_axis_angle(R0.mT @ R).norm(dim=-1), w * whole, atol=1e-6, rtol=0
    )
    torch.testing.assert_close(
        matrix_to_axis_angle(R.mT @ R1).norm(dim=-1), (1 - w) * whole, atol=1e-6, rtol=0
    )


@often
@given(seeds, st.sampled_from([TCDIFFPP, LODGE]), st.integers(1, 9))
def test_mirrored_twice_is_the_same(seed, spec, frames):
    x = normal(seed, 2, frames, spec.dim)
    once = mirror_features(x, spec)
    assert not torch.equal(once, x)
    assert torch.equal(mirror_features(once, spec), x)


@often
@given(seeds, st.sampled_from([TCDIFFPP, LODGE]))
def test_a_mirrored_rotation_is_one(seed, spec):
    d6 = matrix_to_rot6d(rotations(seed, 3 * spec.num_joints)).reshape(3, -1)
    x = torch.cat([normal(seed, 3, 7), d6], -1)
    y = mirror_features(x, spec)[..., spec.rot6d].unflatten(-1, (spec.num_joints, 6))
    R = rot6d_to_matrix(y)
    torch.testing.assert_close(matrix_to_rot6d(R), y, atol=1e-9, rtol=0)  # nothing to mend
    check_rotation(R, 1e-9)
