"""What numbers say of a dance that is watched: each fault is found, and a good dance passes."""

import sys

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
from watched import fine, longest, measured


@pytest.fixture(scope="module")
def joints():
    dance, _ = choreograph(np.arange(0.5, 10, 0.5), dancers=3, seed=3, seconds=10)
    return dance.joints()


def test_the_longest_stretch():
    assert longest([]) == 0 and longest([False] * 9) == 0
    assert longest([True] * 6 + [False] + [True] * 9) == pytest.approx(0.3)


def test_a_choreographed_dance_is_fine(joints):
    assert fine(*measured(joints)[:3])


def test_a_group_that_stands_still_is_not(joints):
    stopped = joints.clone()
    stopped[:, 100:200] = joints[:, 100:101]
    crossed, _, still, _ = measured(stopped)
    assert still == pytest.approx(99 / 30, abs=0.5) and not fine(crossed, 100.0, still)


def test_sliding_feet_are_not(joints):
    slide = torch.linspace(0, 9, joints.shape[1])[:, None] * torch.tensor([1.0, 0.0, 0.0])
    assert not fine(*measured(joints + slide[:, None])[:3])


def test_legs_that_stay_crossed_are_not_and_whose_they_are_does_not_matter(joints):
    crossed = joints.clone()
    left, right = (7, 10), (8, 11)  # ankles and feet
    crossed[2, 50:110, left], crossed[2, 50:110, right] = (
        joints[2, 50:110, right],
        joints[2, 50:110, left],
    )
    seconds = measured(crossed)[0]
    assert seconds == pytest.approx(2.0, abs=0.2) and not fine(seconds, 100.0, 0.0)


def test_who_comes_near_is_told(joints):
    assert measured(joints)[3] > 0.45
    near = joints.clone()
    near[1] += (joints[0, 60, 0] - joints[1, 60, 0]) + torch.tensor([0.2, 0.0, 0.0])
    assert measured(near)[3] <= 0.2 + 1e-5
    assert np.isnan(measured(joints[:1])[3])
