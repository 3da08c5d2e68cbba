import numpy as np
import pytest
import torch

from dancediff.motion.beats import kinematic_energy, mean_speed, motion_beats


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


def test_kinematic_energy_is_half_the_square_of_speed():
    walk = torch.arange(90)[:, None, None] / 30 * torch.tensor([0.6, 0.0, 0.8])
    assert np.allclose(kinematic_energy(walk.expand(90, 24, 3))[10:-10], 0.5)
    assert np.allclose(kinematic_energy(walk.expand(90, 24, 3), fps=60)[20:-20], 2.0)
    assert kinematic_energy(torch.zeros(1, 24, 3)).tolist() == [0.0]


def test_a_rest_within_a_big_movement_has_more_energy_than_one_within_a_small():
    angle = torch.arange(240) / 20 * torch.pi
    size = torch.where(torch.arange(240) < 120, 1.0, 0.3)
    joints = (torch.cos(angle) * size)[:, None, None] * torch.ones(240, 24, 3)
    energy = kinematic_energy(joints)
    assert np.isclose(energy[180] / energy[60], 0.09, rtol=0.01)


def test_a_group_is_refused_since_its_axis_of_dancers_is_no_time():
    group = torch.randn(3, 60, 24, 3)
    for call in (mean_speed, motion_beats, kinematic_energy):
        with pytest.raises(ValueError, match=r"shape \(3, 60, 24, 3\).* one dancer"):
            call(group)
    assert np.array_equal(mean_speed(group[0].numpy()), mean_speed(group[0]))
