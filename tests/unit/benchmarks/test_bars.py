"""A folder of measured dances holds dances made in one way alone."""

import sys

import pytest

from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
from bars import only_one_way


def test_other_options_need_another_folder(tmp_path):
    only_one_way(tmp_path, {"steps": 12, "autoguidance": None})
    only_one_way(tmp_path, {"steps": 12, "autoguidance": None})
    with pytest.raises(SystemExit, match="other options"):
        only_one_way(tmp_path, {"steps": 20, "autoguidance": None})
