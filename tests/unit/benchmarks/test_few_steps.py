"""The table of samplers: a row each, danced to the same windows."""

import json
import sys
from pathlib import Path

from duets import duets
from places import BENCHMARKS
from tiny_tcdiffpp import tiny_tcdiffpp

sys.path.insert(0, str(BENCHMARKS))
import few_steps
from few_steps import FewSteps, options_of


def test_a_row_names_sampler_steps_and_last_guess():
    model = tiny_tcdiffpp().model
    options = options_of("dpm 6 0.16", model)
    assert (options.sampler, options.steps, options.sigma_min) == ("dpm", 6, 0.16)
    assert options_of("ddim 50", model).sigma_min == 0.0


def test_every_sampler_gives_a_row_and_the_truth_is_first(monkeypatch, tmp_path):
    takes = duets()
    pipeline = tiny_tcdiffpp()
    monkeypatch.setattr(few_steps, "prepared_takes", lambda *_: takes)
    monkeypatch.setattr(few_steps, "DANCERS", 4)
    monkeypatch.setattr(few_steps.hub, "load", lambda _: pipeline)
    path = Path(tmp_path / "few.json")
    names = ("dpm 2", "dpm 2 0.5", "ddim 2")
    FewSteps("tiny", "folder", names, batches=1, json_file=path).run()
    rows = json.loads(path.read_text())["rows"]
    assert [row[0] for row in rows] == ["as they were danced", *(f"`{n}`" for n in names)]
    assert [row[1] for row in rows[1:]] == [2, 2, 2]
    fid_k = [row[2][0] for row in rows]
    assert fid_k[0] < min(fid_k[1:]), "random weights dance worse than the choreographer"
    assert len({tuple(row[2]) for row in rows}) == 4, "each sampler dances another dance"
