import pytest
import torch

from dancediff.extensions.aligned_attention import align_attention
from dancediff.motion.representation import LODGE, joints_of, pack
from dancediff.motion.rotation import axis_angle_to_matrix, matrix_to_rot6d
from dancediff.motion.skeleton import FOOT_JOINTS, SMPL24, forward_kinematics
from dancediff.papers.lodge.foot_refine import (
    FootRefine,
    contact_score,
    foot_features,
    step_of,
)


def lodge_motion(f=6, seed=0):
    g = torch.Generator().manual_seed(seed)
    pose = axis_angle_to_matrix(0.5 * torch.randn(f, 24, 3, generator=g))
    pose[:, 22:] = torch.eye(3)
    root, contact = torch.randn(f, 3, generator=g), torch.rand(f, 4, generator=g)
    return pack(contact, root, pose), contact, root, forward_kinematics(pose, root)


def test_joints_are_those_of_the_whole_body_with_straight_hands():
    x, *_, joints = lodge_motion()
    torch.testing.assert_close(joints_of(x[:, :139], LODGE), joints)


def test_the_wrist_still_moves_something():
    x = torch.zeros(1, 139, requires_grad=True)
    still = torch.cat([torch.zeros(7), matrix_to_rot6d(torch.eye(3).expand(22, 3, 3)).flatten()])
    joints_of(x + still, LODGE)[..., SMPL24.index("lhand"), 1].sum().backward()
    assert x.grad[0, 7 + 6 * 20 :][:6].abs().max() > 0.01


def standing(f=5, height=0.0):
    joints = torch.ones(f, 24, 3)
    joints[:, FOOT_JOINTS] = torch.tensor([0.1, 0.02 + height, 0.3])
    return joints


def parts(features):
    return features.unflatten(-1, (4, 4, 3)).unbind(-3)  # label, score, position, velocity


def test_features_of_a_standing_dancer():
    label, score, position, velocity = parts(foot_features(standing()))
    assert (label == 1).all() and (score > 0.9).all() and (velocity == 0).all()
    torch.testing.assert_close(position, torch.tensor([0.1, 0.02, 0.3]).expand(5, 4, 3))


def test_features_of_a_lifted_and_of_a_sliding_foot():
    joints = standing()
    joints[:, 8, 1] = 0.5  # the right ankle is up
    joints[:, 10, 0] += 0.05 * torch.arange(5)  # the left toe slides at 1.5 m/s
    label, score, _, velocity = parts(foot_features(joints))
    assert label[0, :, 0].tolist() == [1, 0, 1, 1]  # the label asks for height alone
    assert score[0, 1].max() < 1e-6 and score[0, 2].max() < 1e-6 and score[0, 0].min() > 0.9
    torch.testing.assert_close(velocity[:, 2], torch.tensor([1.5, 0.0, 0.0]).expand(5, 3))


def test_heights_count_from_the_floor():
    assert parts(foot_features(standing()))[0].min() == 1
    assert parts(foot_features(standing(height=0.7)))[0].max() == 0


def test_velocity_is_cut_and_a_single_frame_has_none():
    joints = standing()
    joints[3:, 7] += 100
    velocity = parts(foot_features(joints))[3]
    assert velocity.abs().max() == 3
    assert step_of(torch.randn(1, 4, 3)).abs().max() == 0
    torch.testing.assert_close(
        step_of(joints[:, FOOT_JOINTS])[:-1], joints[:, FOOT_JOINTS].diff(dim=0)
    )


def test_score_by_hand():
    height, speed = torch.tensor([0.06, 0.12, 0.08, 0.04]), torch.tensor([0.0, 0.01, 0.01, 0.02])
    s = torch.sigmoid(torch.tensor([2.5, 0.0, 0.0, 2.5])) * torch.sigmoid(
        torch.tensor([5.0, 0.0, 0.0, -5.0])
    )
    torch.testing.assert_close(contact_score(height, speed), s)


@pytest.mark.parametrize("where", ["height", "speed"])
def test_score_falls(where):
    top = 0.3 if where == "height" else 0.05
    x, zero = torch.linspace(0, top, 20)[:, None].expand(20, 4), torch.zeros(20, 4)
    score = contact_score(x, zero) if where == "height" else contact_score(zero, x)
    assert (score.diff(dim=0) < 0).all()


def test_a_foot_is_heard_in_its_own_frame_first():
    """The layer's cross-attention starts aligned, and the feet carry the frames of the motion."""
    torch.manual_seed(0)
    refine = FootRefine(64, num_heads=4, ff_dim=64)
    align_attention(refine)
    attention = refine.layer.cross_attention
    x, memory = torch.zeros(1, 30, 64), torch.zeros(1, 30, 64)
    weights = attention.weights(x, memory, torch.arange(30), torch.arange(30))[0]
    assert (weights[0].argmax(-1) == torch.arange(30)).all()


def test_feet_carry_the_frames_of_the_motion_and_steps_none():
    refine, seen = FootRefine(16, num_heads=2, ff_dim=32), []
    refine.layer.register_forward_pre_hook(lambda layer, args: seen.append(args[3:]))
    refine(*(torch.randn(1, *k) for k in ((5, 139), (5, 48), (2, 16), (16,))))
    frames, memory_frames = seen[0]
    assert frames.tolist() == [0, 1, 2, 3, 4]
    assert memory_frames.tolist() == [0, 1, 2, 3, 4, 0, 0]
