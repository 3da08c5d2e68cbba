"""Travelling: a dash is spread over time, everything else keeps its bits."""

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.extensions.speed_limit import TRAVEL_LIMIT, limit_travel
from dancediff.motion.representation import LODGE, TCDIFFPP

X, Y, Z = range(TCDIFFPP.root.start, TCDIFFPP.root.stop)
LONGEST = TRAVEL_LIMIT / 30


@pytest.fixture(scope="module")
def dance():
    """Three dancers, (3, 150, 151)."""
    return choreograph(np.arange(0.3, 5.5, 0.5), dancers=3, seed=3, seconds=5)[0].features()


@pytest.fixture
def dash(dance):
    """The second dancer is 60 cm further to the right, and 30 back, from frame 75 on."""
    x = dance.clone()
    x[1, 75:, X] += 0.6
    x[1, 75:, Z] -= 0.3
    return x


def steps(x):
    return x[..., [X, Z]].diff(dim=-2).norm(dim=-1)


def test_a_dance_keeps_its_bits(dance):
    assert steps(dance).max() < LONGEST
    assert limit_travel(dance) is dance


def test_a_dash_is_spread(dance, dash):
    """No step is too long any more; she sets out and arrives where she did; others stay."""
    calm = limit_travel(dash)
    assert steps(dash)[1].max() > 5 * LONGEST
    assert steps(calm).max() < 1.01 * LONGEST
    torch.testing.assert_close(calm[:, :50], dash[:, :50], atol=1e-3, rtol=0)
    torch.testing.assert_close(calm[:, 100:], dash[:, 100:], atol=1e-3, rtol=0)
    assert torch.equal(calm[[0, 2]], dash[[0, 2]])
    rest = [c for c in range(TCDIFFPP.dim) if c not in (X, Z)]
    assert torch.equal(calm[..., rest], dash[..., rest])


def test_steps_that_are_short_enough_far_away_keep_their_bits(dash):
    calm = limit_travel(dash)
    assert torch.equal(calm[1, :10], dash[1, :10])
    assert torch.equal(calm[1, -10:], dash[1, -10:])


def test_who_cannot_arrive_in_time_is_hardly_faster_than_before():
    """Everywhere twice too fast: nothing grows without bound, and the way is as long."""
    x = torch.zeros(1, 150, TCDIFFPP.dim)
    x[..., X] = torch.linspace(0, 149 * 2 * LONGEST, 150)
    run = limit_travel(x)
    assert steps(run).max() < 1.1 * steps(x).max()
    assert run[0, -1, X].item() == pytest.approx(x[0, -1, X].item())


@pytest.mark.parametrize("frames", [slice(0, 75), slice(75, 150), slice(60, 70)])
def test_held_frames_stay(dash, frames):
    held = torch.zeros(3, 150, dtype=torch.bool)
    held[:, frames] = True
    calm = limit_travel(dash, held)
    torch.testing.assert_close(calm[:, frames], dash[:, frames], atol=1e-6, rtol=0)
    assert steps(calm)[1].max() < 1.05 * LONGEST


def test_between_two_held_frames_a_dash_is_as_long_as_it_must_be(dash):
    held = torch.zeros(3, 150, dtype=torch.bool)
    held[:, [73, 76]] = True  # three steps for 67 cm
    calm = limit_travel(dash, held)
    torch.testing.assert_close(calm[:, [73, 76]], dash[:, [73, 76]], atol=1e-5, rtol=0)
    assert steps(calm)[1].max() == pytest.approx(steps(calm)[1, 73:76].mean().item(), rel=0.1)


def test_at_60_fps_steps_are_half_as_long(dance):
    slow = dance.clone()
    slow[1, 75:, X] += 0.7 * LONGEST
    assert steps(slow).max() < LONGEST
    assert limit_travel(slow) is slow
    assert steps(limit_travel(slow, fps=60)).max() < 1.01 * LONGEST / 2


def test_lodges_vector_travels_like_the_other(dash):
    whole = limit_travel(dash)[..., : LODGE.dim]
    assert torch.equal(limit_travel(dash[..., : LODGE.dim], spec=LODGE), whole)


def test_noise_stays_finite():
    x = 10 * torch.randn(2, 3, 50, 151, generator=torch.Generator().manual_seed(0))
    assert limit_travel(x).isfinite().all()
