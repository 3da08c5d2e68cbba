"""How far a dance is from the soft cues that it was given."""

import sys

import pytest
import torch

from dancediff.motion.representation import LODGE, pack, unpack
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.papers.lodge.choreography import arrange
from dancediff.papers.lodge.segments import segments_of
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
from lodge_bars import off_cues

SEGMENTS = segments_of(1024)


def turned(degrees: float, shape) -> torch.Tensor:
    """Joints that are all turned about one axis."""
    angle = torch.zeros(*shape, 3)
    angle[..., 0] = torch.deg2rad(torch.tensor(degrees))
    return axis_angle_to_matrix(angle)


def cues_turned(degrees: float):
    poses = turned(degrees, (1, 13, 8, 22))
    primitives = pack(torch.zeros(1, 13, 8, 4), torch.zeros(1, 13, 8, 3), poses)
    assert unpack(primitives, LODGE)[2].shape == poses.shape
    return arrange(primitives, SEGMENTS, beats=range(0, 1024, 15), mirror=False)


@pytest.mark.parametrize("degrees", [0.0, 20.0, 90.0])
def test_a_dance_that_stands_is_as_far_from_the_cues_as_they_are_turned(degrees):
    pose = turned(0.0, (1024, 24))
    assert off_cues(pose, cues_turned(degrees), SEGMENTS) == pytest.approx(degrees, abs=0.1)


def test_frames_without_a_cue_do_not_count():
    arrangement = cues_turned(20.0)
    pose = turned(0.0, (1024, 24))
    parts, frames = arrangement.cues().soft.nonzero(as_tuple=True)
    pose[frames + 256 * parts] = turned(20.0, (len(frames), 24))
    assert off_cues(pose, arrangement, SEGMENTS) == pytest.approx(0.0, abs=0.1)


def test_the_root_does_not_count():
    pose = turned(20.0, (1024, 24))
    pose[:, 0] = turned(-90.0, (1024,))
    assert off_cues(pose, cues_turned(20.0), SEGMENTS) == pytest.approx(0.0, abs=0.1)
