"""benchmarks/heard_beats.py: only what is on the beat loses by shifted beats."""

import json
import sys

import numpy as np
import pytest
import torch

from dancediff.bench.held_out import chosen, windows
from dancediff.data.choreographed import choreograph_jobs
from dancediff.data.prepare import prepare
from dancediff.motion.motion import Motion
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
from heard_beats import HeardBeats, heard

BEATS = np.arange(0.5, 5, 0.5)


def turns(every: float) -> Motion:
    """A still pose that goes to and fro, and turns round so often, in seconds."""
    root = torch.zeros(1, 150, 3)
    root[0, :, 0] = torch.cos(torch.pi / every * torch.arange(150) / 30)
    return Motion(torch.eye(3).expand(1, 150, 24, 3, 3), root)


def test_who_turns_on_the_beat_hears_and_who_turns_all_the_time_does_not():
    own, shifted = heard(turns(0.5).joints(), BEATS)
    assert own > 0.9 and shifted < 0.5
    own, shifted = heard(turns(0.23).joints(), BEATS)
    assert own == pytest.approx(shifted, abs=0.1)
    assert heard(turns(0.5).joints(), BEATS[:1])[0] > 0


def test_the_table_reads_the_dances_of_a_run(tmp_path):
    prepare(choreograph_jobs(3, seconds=6, seed=500_000, varied=True), tmp_path / "held")
    for minutes in ("0.01", "10"):
        folder = tmp_path / "edge_tiny-0" / f"{minutes}min" / "dances-150-20"
        folder.mkdir(parents=True)
        for window in chosen(list(windows(str(tmp_path / "held"), 150)), 60):
            dance = window.motion if minutes == "10" else turns(0.23)
            dance.save(folder / f"{window.name}.npz")
    HeardBeats(tmp_path, minutes=10, results=tmp_path).run()
    table = json.loads((tmp_path / "bench_heard.json").read_text())
    truth, edge = table["rows"]
    assert truth[:4] == ["held-out dances", "", "", ""] and edge[0] == "edge_tiny"
    assert edge[4:] == truth[4:]  # it danced what people would see as the truth
    assert edge[3][0] < 0.2 < edge[6][0] and edge[6][0] == pytest.approx(
        edge[4][0] - edge[5][0], abs=0.002
    )
    assert len(table["columns"]) == len(edge) and "--minutes 10" in table["command"]
