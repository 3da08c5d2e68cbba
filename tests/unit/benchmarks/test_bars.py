"""A folder of measured dances holds dances made in one way alone; room is counted in groups."""

import sys

import numpy as np
import pytest

from dancediff.data.choreographer import choreograph
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
from bars import room
from kept_dances import only_one_way


def test_other_options_need_another_folder(tmp_path):
    only_one_way(tmp_path, {"steps": 12, "autoguidance": None})
    only_one_way(tmp_path, {"steps": 12, "autoguidance": None})
    with pytest.raises(SystemExit, match="other options"):
        only_one_way(tmp_path, {"steps": 20, "autoguidance": None})


def test_dances_that_nobody_says_the_making_of_need_another_folder(tmp_path):
    (tmp_path / "dance.npz").touch()
    with pytest.raises(SystemExit, match="other options"):
        only_one_way(tmp_path, {"steps": 12})


def test_frames_with_two_who_are_too_near():
    solo, trio = (
        choreograph(np.arange(0.5, 5, 0.5), dancers=n, seed=0, seconds=5)[0] for n in (1, 3)
    )
    near, _ = choreograph(np.arange(0.5, 5, 0.5), dancers=3, seed=0, seconds=5)
    near.root[1, :75] = near.root[0, :75]  # half of the frames
    row = room([near, trio, solo], [trio])
    assert row["made"][0] == pytest.approx(0.75, abs=0.02) and row["held-out"] == [1, None, None]
    assert room([solo], [trio])["made"] == [None, None, None]
