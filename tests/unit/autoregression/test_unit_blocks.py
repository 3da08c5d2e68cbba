"""Blocks follow each other, each with the units that its motion depends on, and their music."""

import pytest
import torch

from dancediff.autoregression.unit_blocks import HISTORY, blocks, music_after, unit_music
from dancediff.nn.motion_units import FRAMES, REACH


@pytest.mark.parametrize("frames", [1, 64, 65, 1000])
def test_blocks_hold_every_unit_once_and_see_as_far_as_a_frame_depends(frames):
    total, danced = HISTORY - (-frames // FRAMES), []
    for block in blocks(frames):
        near = range(total)[block.near]
        new = near[block.new]
        assert new[0] == block.start
        assert near[0] == max(new[0] - REACH, 0) and near[-1] == min(new[-1] + REACH, total - 1)
        danced += new
    assert danced == [*range(HISTORY, total)]


def test_a_unit_has_the_music_of_the_unit_after_it():
    M = torch.arange(80.0)[:, None]  # ten units
    assert music_after(M, known=HISTORY, seen=1).tolist() == [[*range(8)]]  # before the song
    later = music_after(M, known=HISTORY + 3, seen=3)
    assert torch.equal(later, unit_music(M)[1:4])
