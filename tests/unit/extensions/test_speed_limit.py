"""Speed limit: jumps and dashes take longer, everything else keeps its bits."""

import math

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.extensions.speed_limit import (
    JOINT_LIMIT,
    ROOT_LIMIT,
    TRAVEL_LIMIT,
    limit_travel,
    limit_turns,
    turn_angles,
)
from dancediff.motion.representation import LODGE, TCDIFFPP, pack, unpack
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import SMPL24

X, Y, Z = range(TCDIFFPP.root.start, TCDIFFPP.root.stop)
LONGEST = TRAVEL_LIMIT / 30


@pytest.fixture(scope="module")
def dance():
    """Three dancers, (3, 150, 151)."""
    return choreograph(np.arange(0.3, 5.5, 0.5), dancers=3, seed=3, seconds=5)[0].features()


def about(axis, angle):
    return axis_angle_to_matrix(angle * torch.tensor(axis, dtype=torch.float32))


def turned(dance, joint, start, angle, axis=(0.0, 1.0, 0.0)):
    """The dance, with one joint of the second dancer turned from a frame on."""
    contact, root, pose = unpack(dance.clone())
    pose[1, start:, joint] = about(axis, angle) @ pose[1, start:, joint]
    return pack(contact, root, pose)


def angles(x):
    return turn_angles(unpack(x)[2])


def test_angles_of_a_known_turn():
    steps = torch.tensor([0.0, 0.1, 0.3, 0.3])
    R = torch.stack([about((0.0, 0.0, 1.0), a) for a in steps])[:, None]
    torch.testing.assert_close(turn_angles(R)[:, 0], steps.diff(), atol=1e-3, rtol=0)


@pytest.mark.parametrize("angle", [0.5, 2.0, 4.3])
def test_a_jump_is_spread_along_the_shorter_way(dance, angle):
    """A rotation is two quaternions; somewhere on the way round they change sign."""
    contact, root, pose = unpack(dance[:1].clone())
    pose[0, :75, 0] = about((0.0, 1.0, 0.0), angle)
    pose[0, 75:, 0] = about((0.0, 1.0, 0.0), angle + 1.2)
    way = angles(limit_turns(pack(contact, root, pose)))[0, :, 0]
    assert way.sum().item() == pytest.approx(1.2, abs=0.1) and way.max() < 1.5 * ROOT_LIMIT


@pytest.mark.parametrize("apart", [3, 5, 8])
def test_two_jumps_that_turn_a_body_once_around_leave_it_where_it_was(dance, apart):
    """Once around, a quaternion has changed its sign: the way from q to -q leads through zero."""
    twice = dance
    for start, angle in ((75, 2.8), (75 + apart, 2.4)):
        twice = turned(twice, 0, start, angle)
    assert angles(twice)[1, :, 0].max() > 2
    way = angles(limit_turns(twice))[1, :, 0]
    assert way.max() < 1.5 * ROOT_LIMIT
    assert way[60:100].sum() < 2 * math.pi - 5.2 + angles(dance)[1, 60:100, 0].sum() + 0.1


def test_a_dance_keeps_its_bits(dance):
    assert limit_turns(dance) is dance
    assert steps(dance).max() < LONGEST
    assert limit_travel(dance) is dance


@pytest.mark.parametrize("joint, limit", [("root", ROOT_LIMIT), ("lshoulder", JOINT_LIMIT)])
@pytest.mark.parametrize("angle", [1.0, 2.0, 3.1])
def test_a_jump_is_spread(dance, joint, limit, angle):
    """The same turn in the end, at about the limit, by that joint of that dancer only."""
    j = SMPL24.index(joint)
    jumps = turned(dance, j, 75, angle)
    assert angles(jumps)[1, 74, j] > limit
    smooth = limit_turns(jumps)
    assert angles(smooth)[1, :, j].max() < 1.5 * limit
    torch.testing.assert_close(smooth[:, :60], jumps[:, :60], atol=0.005, rtol=0)
    torch.testing.assert_close(smooth[:, 91:], jumps[:, 91:], atol=0.005, rtol=0)
    others = [c for c in range(TCDIFFPP.dim) if c not in TCDIFFPP.joint_channels([j])]
    assert torch.equal(smooth[..., others], jumps[..., others])
    assert torch.equal(smooth[[0, 2]], jumps[[0, 2]])


def test_fixed_frames_do_not_turn(dance):
    """A jump right behind them is spread over the frames that may change."""
    jumps = turned(dance, 0, 75, 3.0)
    fixed = torch.zeros(3, 150, dtype=torch.bool)
    fixed[:, :75] = True
    smooth = limit_turns(jumps, fixed)
    assert torch.equal(smooth[:, :75], jumps[:, :75])
    before, after = angles(jumps)[1, :, 0].max(), angles(smooth)[1, :, 0].max()
    assert after < before / 2


def test_a_mask_without_batch_serves_every_row(dance):
    fixed = torch.zeros(3, 150, dtype=torch.bool)
    jumps = turned(dance, 0, 75, 3.0)
    assert torch.equal(limit_turns(jumps[None], fixed)[0], limit_turns(jumps, fixed))


def test_at_60_fps_bodies_turn_half_as_far(dance):
    slow = turned(dance, 0, 75, 0.9 * ROOT_LIMIT)
    assert limit_turns(slow) is slow
    assert limit_turns(slow, fps=60) is not slow


def test_lodges_vector_turns_like_the_other(dance):
    jumps = turned(dance, SMPL24.index("lelbow"), 40, math.pi * 0.9)
    whole = limit_turns(jumps)[..., : LODGE.dim]
    assert torch.equal(limit_turns(jumps[..., : LODGE.dim], spec=LODGE), whole)


@pytest.fixture
def dash(dance):
    """The second dancer is 60 cm further to the right, and 30 back, from frame 75 on."""
    x = dance.clone()
    x[1, 75:, X] += 0.6
    x[1, 75:, Z] -= 0.3
    return x


def steps(x):
    return x[..., [X, Z]].diff(dim=-2).norm(dim=-1)


def test_a_dash_is_spread(dance, dash):
    """No step is too long any more; the dancer starts and arrives in place; others stay."""
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
def test_fixed_frames_do_not_travel(dash, frames):
    fixed = torch.zeros(3, 150, dtype=torch.bool)
    fixed[:, frames] = True
    calm = limit_travel(dash, fixed)
    torch.testing.assert_close(calm[:, frames], dash[:, frames], atol=1e-6, rtol=0)
    assert steps(calm)[1].max() < 1.05 * LONGEST


def test_between_two_fixed_frames_a_dash_is_as_long_as_it_must_be(dash):
    fixed = torch.zeros(3, 150, dtype=torch.bool)
    fixed[:, [73, 76]] = True  # three steps for 67 cm
    calm = limit_travel(dash, fixed)
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
    x = torch.randn(2, 3, 50, 151, generator=torch.Generator().manual_seed(0))
    assert limit_turns(x).isfinite().all()
    assert limit_travel(10 * x).isfinite().all()
