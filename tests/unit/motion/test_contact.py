import torch

from dancediff.motion.contact import feet_low, foot_contact, foot_speed
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import FOOT_JOINTS


def feet_at(height, step=0.0, frames=6):
    joints = torch.zeros(frames, 24, 3)
    joints[:, FOOT_JOINTS, 1] = height
    joints[:, FOOT_JOINTS, 0] = step * torch.arange(frames)[:, None]
    return joints


def test_low_and_still_is_contact():
    assert foot_contact(feet_at(0.03)).all()


def test_low_but_sliding_is_none():
    """Lodge's height-only rule would call this planted."""
    joints = feet_at(0.03, step=0.02)
    assert not foot_contact(joints).any() and feet_low(joints).all()


def test_still_but_high_is_none():
    """EDGE's speed-only rule would call this planted."""
    assert not foot_contact(feet_at(0.5)).any()


def test_ankles_and_toes_have_their_own_heights():
    assert foot_contact(feet_at(0.08))[0].tolist() == [1, 1, 0, 0]


def test_speed_is_to_the_next_frame_in_the_floor_plane():
    joints = feet_at(0.0)
    joints[3:, 7, 2] = 0.3
    joints[:, 8, 1] = torch.arange(6.0)  # straight up: no horizontal speed
    speed = foot_speed(joints)
    assert torch.allclose(speed[:, 0], torch.tensor([0, 0, 0.3, 0, 0, 0]))
    assert speed[:, 1].abs().max() == 0


def test_one_frame_has_no_speed():
    assert foot_contact(feet_at(0.03, frames=1)).all()


def test_a_slide_is_one_at_any_frame_rate():
    for fps in (30, 60, 120):
        joints = feet_at(0.03, step=0.6 / fps)  # metres a second
        still = Motion(torch.eye(3).expand(1, 6, 24, 3, 3), torch.zeros(1, 6, 3), fps)
        still.joints = lambda joints=joints: joints[None]
        assert not foot_contact(joints, fps).any() and not still.contacts().any()
        assert foot_contact(feet_at(0.03, step=0.15 / fps), fps).all()
