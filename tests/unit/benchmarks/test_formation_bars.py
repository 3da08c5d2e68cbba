"""benchmarks/formation_bars.py: which bars hold for groups that stand, walk, or dance."""

import json
import sys

import numpy as np
import pytest
import torch

from dancediff.data.choreographed import choreograph_jobs
from dancediff.data.choreographer import choreograph
from dancediff.data.prepare import prepare
from dancediff.motion.motion import Motion
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
import formation_bars as bench


def dance_of(n: int, seed: int) -> Motion:
    return choreograph(np.arange(0.5, 30, 0.5), dancers=n, seed=seed, seconds=30.0)[0]


@pytest.fixture(scope="module")
def truth():
    return [dance_of(n, seed).joints() for n in (3, 5) for seed in range(4)]


def test_the_choreographer_holds_his_own_bars(truth):
    rows = {row.name: row for row in bench.rows_of(truth, truth)}
    assert all(row.holds for name, row in rows.items() if "5 dancers, formations" not in name)
    assert len(rows) == 2 * len(bench.GROUPS) + len(bench.LEGS)


def test_a_group_that_stands_still_in_one_line_fails(truth):
    still = [joints[:, :1].expand(-1, 900, -1, -1) for joints in truth]
    rows = {row.name: row for row in bench.rows_of(still, truth)}
    assert rows["5 dancers, formations in 30 s"].made == [1.0] * 4
    assert not rows["5 dancers, formations in 30 s"].holds
    assert not rows["under 5 cm in 3 s"].holds
    flat = [joints * torch.tensor([1.0, 1.0, 0.0]) for joints in truth]  # nobody has depth
    rows = {row.name: row for row in bench.rows_of(flat, truth)}
    assert not rows["3 dancers, hull area, m²"].holds and not rows["5 dancers, depth, m"].holds


def test_a_size_that_is_missing_is_told(truth):
    with pytest.raises(ValueError, match="0 dances and 4 held-out ones have 5 dancers"):
        bench.rows_of([joints for joints in truth if len(joints) == 3], truth)


def test_the_table_is_written(tmp_path):
    jobs = choreograph_jobs(10, seconds=31.0, seed=500000)
    prepare(jobs, tmp_path / "held", workers=2, progress=False)
    folder = tmp_path / "dances"
    folder.mkdir()
    for n in (3, 5):
        for seed in range(2):
            dance_of(n, seed).save(folder / f"{n}-{seed}.npz")
    bench.FormationBars(folder, str(tmp_path / "held"), results=tmp_path).run()
    table = json.loads((tmp_path / "tcdiffpp_formations.json").read_text(encoding="utf-8"))
    assert all(len(row) == len(table["columns"]) for row in table["rows"])
