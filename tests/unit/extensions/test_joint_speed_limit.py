"""Turning: jumps are spread over time, everything else keeps its bits."""

import math

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.extensions.speed_limit import JOINT_LIMIT, ROOT_LIMIT, limit_turns, turn_angles
from dancediff.motion.representation import LODGE, TCDIFFPP, pack, unpack
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import SMPL24


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


def test_a_dance_keeps_its_bits(dance):
    assert limit_turns(dance) is dance


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


def test_known_frames_stay(dance):
    """A jump right behind them is spread over the frames that may change."""
    jumps = turned(dance, 0, 75, 3.0)
    held = torch.zeros(3, 150, dtype=torch.bool)
    held[:, :75] = True
    smooth = limit_turns(jumps, held)
    assert torch.equal(smooth[:, :75], jumps[:, :75])
    before, after = angles(jumps)[1, :, 0].max(), angles(smooth)[1, :, 0].max()
    assert after < before / 2


def test_a_mask_without_batch_serves_every_row(dance):
    held = torch.zeros(3, 150, dtype=torch.bool)
    jumps = turned(dance, 0, 75, 3.0)
    assert torch.equal(limit_turns(jumps[None], held)[0], limit_turns(jumps, held))


def test_at_60_fps_bodies_turn_half_as_far(dance):
    slow = turned(dance, 0, 75, 0.9 * ROOT_LIMIT)
    assert limit_turns(slow) is slow
    assert limit_turns(slow, fps=60) is not slow


def test_lodges_vector_turns_like_the_other(dance):
    jumps = turned(dance, SMPL24.index("lelbow"), 40, math.pi * 0.9)
    whole = limit_turns(jumps)[..., : LODGE.dim]
    assert torch.equal(limit_turns(jumps[..., : LODGE.dim], spec=LODGE), whole)


def test_noise_stays_finite():
    x = torch.randn(2, 3, 50, 151, generator=torch.Generator().manual_seed(0))
    assert limit_turns(x).isfinite().all()
