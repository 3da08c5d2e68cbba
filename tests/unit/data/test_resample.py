import pytest
import torch

from dancediff.data.resample import resample_motion
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import axis_angle_to_matrix


def turning(frames: int, fps: float, *, dancers: int = 2) -> Motion:
    """Every joint turns about its own axis at 1 rad/s; the root walks 1 m/s."""
    seconds = torch.arange(frames) / fps
    axes = torch.nn.functional.normalize(torch.randn(dancers, 1, 24, 3), dim=-1)
    pose = axis_angle_to_matrix(axes * seconds[:, None, None])
    root = torch.stack([seconds, 0 * seconds + 1, -seconds], -1).expand(dancers, -1, -1)
    return Motion(pose, root, fps)


@pytest.mark.parametrize("frames", [1, 2, 60, 61, 300])
def test_60_to_30_takes_every_other_frame_exactly(frames):
    motion = turning(frames, 60)
    half = resample_motion(motion, 30)
    assert half.pose.equal(motion.pose[:, ::2])
    assert half.root.equal(motion.root[:, ::2])


@pytest.mark.parametrize(("old", "new"), [(60, 25), (24, 30), (120, 30), (29.97, 30)])
def test_a_steady_turn_stays_steady(old, new):
    motion = turning(100, old)
    torch.manual_seed(0)
    result = resample_motion(motion, new)
    assert result.num_frames == int(99 * new / old + 1e-6) + 1
    torch.manual_seed(0)
    truth = turning(result.num_frames, new)
    truth.pose = motion.pose[:, :1] @ truth.pose
    assert (result.root - truth.root).abs().max() < 1e-4
    step = result.pose[:, 1:] @ result.pose[:, :-1].mT
    angle = ((step.diagonal(dim1=-2, dim2=-1).sum(-1) - 1) / 2).clamp(-1, 1).acos()
    assert (angle - 1 / new).abs().max() < 3e-3
    identity = result.pose @ result.pose.mT
    assert (identity - torch.eye(3)).abs().max() < 1e-5


def test_same_rate_is_the_same_motion_and_contacts_follow():
    motion = turning(20, 30)
    assert resample_motion(motion, 30) is motion
    labels = (torch.arange(20) + 1) // 2 % 2  # 0 1 1 0: no frame has that of the one before it
    motion.contact = labels[None, :, None].expand(2, 20, 4).float()
    assert torch.equal(resample_motion(motion, 15).contact, motion.contact[:, ::2])


@pytest.mark.parametrize("fps", [0, -30, float("nan"), float("inf")])
def test_no_frame_rate_is_refused(fps):
    with pytest.raises(ValueError, match="fps="):
        resample_motion(turning(3, 30), fps)
