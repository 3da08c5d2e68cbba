import numpy as np
import torch

from dancediff.motion.beats import mean_speed, motion_beats


def test_beats_are_where_a_swing_turns_round():
    angle = torch.arange(120) / 20 * torch.pi  # a turning point every 20 frames
    joints = torch.cos(angle)[:, None, None] * torch.ones(120, 24, 3)
    assert motion_beats(joints).tolist() == [20, 40, 60, 80, 100]


def test_a_still_or_tiny_clip_has_none():
    assert len(motion_beats(torch.zeros(30, 24, 3))) == 0
    assert mean_speed(torch.zeros(1, 24, 3)).tolist() == [0.0]


def test_speed_is_metres_a_frame():
    joints = torch.arange(10.0)[:, None, None] * torch.tensor([0.03, 0.0, 0.04])
    assert np.allclose(mean_speed(joints.expand(10, 24, 3)), 0.05)
