"""benchmarks/bench_tables.py, package_systems.py: a run's numbers and networks are packaged."""

import json
import os
import sys

import pytest
import torch

from dancediff import hub
from dancediff.extensions.build import build
from dancediff.papers.edge.model import EDGE, EDGEConfig
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
import bench_tables
import package_systems

SCORE = {"value": 20.123, "low": 18.0, "high": 22.0}


@pytest.fixture
def runs(tmp_path):
    """What `dancediff bench-models` leaves: one system, two seeds."""
    rows = [
        {"variant": "edge_tiny, 10 min", "scores": {"FID_k": SCORE, "MMC": SCORE | {"low": None}}},
        {"variant": "mean pose", "scores": {"FID_k": {"value": float("nan"), "low": 1, "high": 2}}},
    ]
    points = [{"seed": 0}, {"seed": 1}, {"seed": 1}]
    (tmp_path / "results.json").write_text(json.dumps({"rows": rows, "points": points}))
    for minutes, score in (("0.01", [900.0, None, None]), ("10", [20.123, 18.0, 22.0])):
        branch = tmp_path / "edge_tiny-0" / f"{minutes}min"
        for k, (stage, losses) in enumerate(
            (("units", [4] * 10 + [1] * 100), ("gpt", [8] * 10 + [4] * 100))
        ):
            (branch / stage).mkdir(parents=True)
            text = "".join(f"{step},{loss}\n" for step, loss in enumerate(losses))
            (branch / stage / "losses.csv").write_text(f"step,total\n{text}", encoding="utf-8")
            (branch / stage / "spent.jsonl").touch()
            os.utime(branch / stage / "spent.jsonl", (k, k))
        known = {"scores": {"150": dict.fromkeys(bench_tables.LEARNED, score)}}
        (branch / "point.json").write_text(json.dumps(known))
    paper = {"tcdiffpp": [["FID: 1 of 1", "EDGE", 31.4, 1, [20.123, None, None], 1]]}
    (tmp_path / "papers.json").write_text(json.dumps(paper))
    return tmp_path


def test_tables_have_the_values_and_say_how_many_seeds(runs, tmp_path):
    (tmp_path / "results").mkdir()
    bench_tables.BenchTables(runs, minutes=10, results=tmp_path / "results").run()
    table, learned = (
        json.loads((tmp_path / "results" / f"{name}.json").read_text())
        for name in ("bench", "bench_learned")
    )
    assert learned["columns"][:3] == ["system", "FID_k, untrained", "FID_g, untrained"]
    assert learned["rows"] == [
        ["edge_tiny", 900, 900, 900, *[[20.1, 18, 22]] * 3, "units", 4, 1, 0.25],
        [*[""] * 7, "gpt", 8, 4, 0.5],
    ]
    assert learned["seed"] == "0" and "--minutes 0.01 10 " in learned["command"]
    assert table["columns"] == ["system", "FID_k", "MMC"]
    assert table["rows"] == [["edge_tiny", [20.1, 18, 22], 20.1], ["mean pose", None, None]]
    assert table["seed"] == "0 1" and "--minutes 10 --seeds 0 1 " in table["command"]
    beside = json.loads((tmp_path / "results" / "papers_tcdiffpp.json").read_text())
    assert beside["rows"] == [["FID: 1 of 1", "EDGE", 31.4, 1, 20.1, 1]]


def test_a_run_by_windows_has_a_table_of_its_own(runs, tmp_path):
    (tmp_path / "results").mkdir()
    bench_tables.BenchTables(runs, windows=8000, results=tmp_path / "results").run()
    (file,) = (tmp_path / "results").iterdir()
    table = json.loads(file.read_text())
    assert file.name == "bench_windows.json"
    assert table["rows"][0] == ["edge_tiny", [20.1, 18, 22], 20.1]
    assert "--minutes --windows 8000 " in table["command"]
    assert table["command"].endswith("--out runs/bench_windows")
    for both in ({}, {"minutes": 10, "windows": 8000}):
        with pytest.raises(ValueError, match="name one budget"):
            bench_tables.BenchTables(runs, **both).run()


def test_a_packaged_system_is_the_run_s_network_with_its_scores(tmp_path, monkeypatch):
    torch.manual_seed(0)
    model = build(EDGE, EDGEConfig(d_model=16, num_heads=2, num_layers=1, ff_dim=32))
    for seed, value in ((0, 20.123), (1, 30.5)):
        branch = tmp_path / "runs" / f"edge_tiny-{seed}" / "10min"
        hub.save_model(model, branch / "model")
        scores = {"150": {"FID_k": [value, 18.0, 40.0], "GMR": [2.0, None, None]}}
        point = {"config": "edge_tiny", "seed": seed, "minutes": 10, "weights": 1e6, "step": 1234}
        point |= {"how": {"count": 60}, "scores": scores}
        (branch / "point.json").write_text(json.dumps(point))
    monkeypatch.setattr(package_systems, "SYSTEMS", {"edge": package_systems.SYSTEMS["edge"]})
    with pytest.raises(FileNotFoundError):
        package_systems.PackageSystems(tmp_path / "runs", minutes=5, out=tmp_path / "m").run()
    package_systems.PackageSystems(tmp_path / "runs", minutes=10, seed=1, out=tmp_path / "m").run()
    found = hub.load(tmp_path / "m" / "edge").model
    for key, tensor in model.state_dict().items():
        assert torch.equal(found.state_dict()[key], tensor.half().float()), key
    card = " ".join((tmp_path / "m" / "edge" / "card.md").read_text().split())
    assert "FID_k 30.5 [18, 40]" in card and "GMR" not in card
    assert "--seeds 1" in card and "1,234 steps" in card
