"""Cues are met without a jerk: `dancediff.extensions.border_smoothing`, and smooth primitives."""

import pytest
import torch

from dancediff.extensions.border_smoothing import BorderSmoothing, smooth_borders
from dancediff.extensions.smooth_primitives import smooth_primitives
from dancediff.motion.representation import LODGE
from dancediff.motion.rotation import matrix_to_rot6d, rot6d_to_matrix


def wave(f=64):
    """A dance whose rotations swing, all alike."""
    angle = torch.linspace(0, 6, f)[:, None]
    x = torch.zeros(f, 139)
    x[:, LODGE.rot6d] = torch.sin(angle + torch.arange(132) / 20)
    return x[None]


def largest_change(x, where):
    return x[..., LODGE.rot6d].diff(n=2, dim=1).abs().amax(-1)[0, where].max()


def test_a_jump_beside_a_cue_is_spread_out():
    x, fixed = wave(), torch.zeros(1, 64, dtype=torch.bool)
    fixed[:, :4] = fixed[:, -4:] = True
    x[fixed] += 0.2
    joined = smooth_borders(x, fixed)
    assert torch.equal(joined[fixed], x[fixed])
    borders = [1, 2, 3, 4, 57, 58, 59, 60]
    assert largest_change(joined, borders) < 0.4 * largest_change(x, borders)
    assert torch.equal(joined[..., : LODGE.rot6d.start], x[..., : LODGE.rot6d.start])


def test_it_is_the_minimum_that_the_docstring_says():
    """Against the dense system, with u = 0 where frames are fixed."""
    torch.manual_seed(0)
    x, fixed = torch.randn(1, 20, 139).double(), torch.arange(20)[None] < 4
    u = (smooth_borders(x, fixed) - x)[0, 4:, LODGE.rot6d]
    bend = torch.eye(20, dtype=torch.float64).diff(n=2, dim=0)
    away = [max(3 - i, i - 4, 0) for i in range(1, 19)]  # the border is between 3 and 4
    w = 300 * torch.exp(-torch.tensor(away, dtype=torch.float64) / 2)
    A = torch.eye(16).double() + bend[:, 4:].mT @ ((100 + w)[:, None] * bend[:, 4:])
    b = -bend[:, 4:].mT @ (w[:, None] * (bend @ x[0][:, LODGE.rot6d]))
    torch.testing.assert_close(u, torch.linalg.solve(A, b), atol=1e-6, rtol=1e-6)


@pytest.mark.parametrize("mask", [torch.zeros(1, 64).bool(), torch.ones(1, 64).bool()])
def test_without_a_border_nothing_is_moved(mask):
    torch.testing.assert_close(smooth_borders(wave(), mask), wave(), atol=1e-6, rtol=0)


def test_rows_do_not_know_of_each_other():
    x, fixed = torch.cat([wave(), 2 * wave()]), torch.arange(64).expand(2, 64) < 4
    assert torch.equal(smooth_borders(x, fixed)[:1], smooth_borders(x[:1], fixed[:1]))


def test_guesses_that_are_more_signal_than_noise_are_smoothed_towards_their_cues():
    x, frames = wave(), torch.arange(64)[None] < 4
    hard, y = frames[..., None].expand(x.shape), wave() + 0.3
    hook = BorderSmoothing(hard, y, frames)
    assert torch.equal(hook.apply(x, 0.4), x)
    met = hook.apply(x, 0.6)
    torch.testing.assert_close(met[:, :4], y[:, :4])
    torch.testing.assert_close(met, smooth_borders(torch.where(hard, y, x), frames))


def test_a_primitive_keeps_its_acceleration():
    """Directions that go along a parabola are fitted exactly, and only their length changes."""
    tau = torch.linspace(-1, 1, 8)
    x = torch.zeros(2, 8, 139)
    x[..., LODGE.rot6d] = matrix_to_rot6d(torch.eye(3).expand(22, 3, 3)).flatten()
    x[..., LODGE.rot6d.start + 1] = 0.4 * tau**2 - 0.3 * tau
    R = rot6d_to_matrix(x[..., LODGE.rot6d].unflatten(-1, (-1, 6)))
    torch.testing.assert_close(smooth_primitives(x)[..., 7:], matrix_to_rot6d(R).flatten(-2))


def test_a_parabola_stays_and_jitter_goes():
    tau = torch.linspace(-1, 1, 8)[:, None]
    x = torch.zeros(2, 8, 139)
    x[..., LODGE.rot6d] = matrix_to_rot6d(torch.eye(3).expand(22, 3, 3)).flatten()
    x[..., LODGE.rot6d.start] += 0.3 * tau[:, 0] ** 2  # the first column grows, and is cut to 1
    torch.testing.assert_close(smooth_primitives(x)[..., 7], torch.ones(2, 8))
    shaken = x + 0.05 * torch.randn(x.shape, generator=torch.Generator().manual_seed(0))
    smooth = smooth_primitives(shaken)
    assert largest_change(smooth, slice(None)) < 0.5 * largest_change(shaken, slice(None))
    R = rot6d_to_matrix(smooth[..., LODGE.rot6d].unflatten(-1, (-1, 6)))
    torch.testing.assert_close(R @ R.mT, torch.eye(3).expand(R.shape), atol=1e-5, rtol=0)
