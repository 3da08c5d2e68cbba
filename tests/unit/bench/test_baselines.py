"""Dances that nobody learned: the truth, a mean pose, and frames in a random order."""

import numpy as np
import pytest
import torch

from dancediff.bench.baselines import BASELINES, mean_poses, shuffled_frames, true_dances
from dancediff.bench.held_out import Window
from dancediff.data.choreographed import choreographed_takes
from dancediff.motion.rotation import matrix_to_rot6d


@pytest.fixture(scope="module")
def some():
    takes = [choreographed_takes(seed, seconds=3.0, sizes=(2,))[0] for seed in range(3)]
    M, beats = torch.zeros(90, 35), np.arange(6) / 2
    return [Window(f"w{k}", "synthetic", t.motion, M, beats) for k, t in enumerate(takes)]


@pytest.mark.parametrize("name", BASELINES)
def test_every_window_has_a_dance_of_its_size(name, some):
    for window, dance in zip(some, BASELINES[name](some), strict=True):
        assert dance.root.shape == window.motion.root.shape
        assert dance.pose.shape == window.motion.pose.shape


def test_the_truth_is_the_windows_own_dance(some):
    assert true_dances(some)[1] is some[1].motion


def test_in_a_mean_pose_nobody_moves_and_everybody_looks_alike(some):
    dances = mean_poses(some)
    joints = torch.cat([dance.joints() - dance.root[:, :, None] for dance in dances])
    torch.testing.assert_close(joints, joints[:1, :1].expand_as(joints), rtol=0, atol=1e-5)
    for window, dance in zip(some, dances, strict=True):
        mean = window.motion.root.mean(1, keepdim=True).expand_as(dance.root)
        torch.testing.assert_close(dance.root, mean, rtol=0, atol=1e-5)


def test_the_mean_pose_is_nearer_to_all_frames_than_another_frame_is(some):
    def six(dance):
        return matrix_to_rot6d(dance.pose).flatten(0, 1)

    frames = torch.cat([six(window.motion) for window in some])
    mean = six(mean_poses(some)[0])[0]
    error = (frames - mean).square().mean()
    assert all(error < (frames - frame).square().mean() for frame in frames[::30])


def test_shuffled_frames_are_the_same_frames_for_all_dancers_and_seeds(some):
    window, dance = some[0], shuffled_frames(some)[0]
    order = [
        (window.motion.root[0] == root).all(-1).nonzero()[0, 0].item() for root in dance.root[0]
    ]
    assert sorted(order) == list(range(90)) and order != list(range(90))
    assert torch.equal(dance.pose, window.motion.pose[:, order])
    assert torch.equal(dance.pose, shuffled_frames(some)[0].pose)
    assert not torch.equal(dance.pose, shuffled_frames(some, seed=1)[0].pose)
