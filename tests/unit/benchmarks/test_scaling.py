"""benchmarks/scaling.py with budgets of a second: trainings, branches, dances, table, figure."""

import doctest
import json
import sys

import pytest

from dancediff.bench.budget import spent_until
from dancediff.data.choreographed import choreograph_jobs, choreographed_takes
from dancediff.data.prepare import prepare
from dancediff.training.checkpoint import NAME, read_facts
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
import scaling as bench

MODEL = """
[data]
dancers_per_batch = 4
[model]
class = "{kind}"
d_model = 16
num_layers = 1
num_heads = 2
ff_dim = 32
extensions = ["preconditioning"]
[train]
steps = 4
warmup = 1
save_every = 2
"""
SECONDS = 60.0  # of a minute


@pytest.fixture(scope="module")
def takes():
    return choreographed_takes(0, seconds=6.0, sizes=(1, 2))


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scaling") / "held"
    prepare(choreograph_jobs(4, seconds=6.0, sizes=(2,), seed=50), folder, progress=False)
    return folder


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(MODEL.format(kind="TCDiffPP"), encoding="utf-8")
    return path


def test_branches_leave_one_run_and_end_with_their_budget(config, takes, tmp_path):
    run = bench.Run(config, 1, tmp_path / "run", None, takes)
    budgets = (0.6 / SECONDS, 1.2 / SECONDS)
    found = dict(run.models(budgets))
    assert list(found) == list(budgets)
    lines = [bench.last_line(folder) for folder in found.values()]
    for budget, line, folder in zip(budgets, lines, found.values(), strict=True):
        assert line["spent"] == pytest.approx(60 * budget, rel=0.8)  # steps are few and uneven
        assert line["windows"] == 4 * line["step"]
        facts = read_facts(folder / NAME)
        assert facts["step"] == line["step"]
        train = facts["config"]["train"]
        assert train["steps"] == line["step"]
        assert train["decay"] == pytest.approx(0.2, abs=0.15)
        assert train["seed"] == 1
    assert lines[0]["step"] < lines[1]["step"]
    stable = read_facts(tmp_path / "run" / NAME)
    assert stable["config"]["train"]["decay"] == 0
    times = [(folder / "model" / "config.json").stat().st_mtime_ns for folder in found.values()]
    again = dict(run.models(budgets))  # nothing is trained twice
    assert [(f / "model" / "config.json").stat().st_mtime_ns for f in again.values()] == times
    with pytest.raises(ValueError, match="shorter budget"):
        list(run.models((0.1 / SECONDS,)))


def test_what_was_spent_is_known_after_a_pause(config, takes, tmp_path):
    run = bench.Run(config, 0, tmp_path / "run", None, takes)
    run.stable(0.3 / SECONDS)
    first = bench.last_line(run.folder)
    run.stable(0.6 / SECONDS)
    second = bench.last_line(run.folder)
    assert second["spent"] > first["spent"] >= 0.3
    assert second["step"] > first["step"]
    assert second["windows"] == 4 * second["step"]
    (run.folder / "spent.jsonl").unlink()
    with pytest.raises(ValueError, match="does not say what the first"):
        spent_until(run.folder, second["step"])


def test_the_bar_of_a_budget_counts_minutes_not_ten_million_steps(config, takes, tmp_path, capsys):
    bench.Run(config, 0, tmp_path / "run", None, takes).stable(0.3 / SECONDS)
    shown = capsys.readouterr().err
    assert "training, 0.0 min of computing" in shown
    assert "10000000" not in shown


def test_points_are_scored_searched_written_and_drawn(takes, held, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    configs = []
    for kind in ("TCDiffPP", "EDGE"):
        configs.append(tmp_path / f"{kind}.toml")
        configs[-1].write_text(MODEL.format(kind=kind), encoding="utf-8")
    made = bench.Run
    monkeypatch.setattr(bench, "Run", lambda *args: made(*args, takes))
    sampling = bench.Sampling(**bench.asdict(bench.BARE) | {"steps": 2})
    options = {"minutes": (0.3 / SECONDS,), "seeds": (0,), "frames": (170,), "count": 4}
    options |= {
        "tuned": 3,
        "autoguidance": (1.0, 2.0),
        "ends": (0.0, 0.3),
        "sampling": sampling,
        "workers": 1,
    }
    bench.Scaling(tuple(configs), held, held, held, **options).run()
    results = tmp_path / "docs/results"
    page = json.loads((results / "scaling.json").read_text(encoding="utf-8"))
    *ours, truth = page["rows"]
    assert [row[:4] for row in ours] == [[c.stem, 0, 170, 1] for c in configs]
    assert truth[:5] == ["held-out", None, 170, None, None]
    assert truth[5][0] == pytest.approx(0, abs=1e-3)  # FID_k: their takes are the reference, too
    assert truth[-1] == 1.0
    table = json.loads((results / "scaling_points.json").read_text(encoding="utf-8"))
    assert len(table["rows"]) == 2
    rows = [dict(zip(table["columns"], row, strict=True)) for row in table["rows"]]
    assert {row["config"] for row in rows} == {"TCDiffPP", "EDGE"}
    assert all(isinstance(row["FID_k"], list) and row["FID_k"][0] > 0 for row in rows)
    assert all(0 <= row["orders kept"] <= 1 for row in rows)
    assert all(row["autoguidance"] in (1.0, 2.0) for row in rows)
    assert [row[5] for row in ours] == [row["FID_k"][0] for row in rows]  # of one seed
    assert (tmp_path / "docs/images/scaling.png").stat().st_size > 10_000
    point = json.loads(next(tmp_path.rglob("point.json")).read_text(encoding="utf-8"))
    assert set(point["searched"]) == {"1, 0", "2, 0", "2, 0.3"}
    made_with = bench.Motion.load(next(tmp_path.rglob("170/*.npz"))).meta
    off = ("foot_contact", "collision_avoidance", "order_constraint", "frequency_clip")
    assert not any(made_with.get(name) for name in off)


def test_first_seed_alone_goes_beyond_many_seeds():
    scaling = bench.Scaling((), None, None, None)
    assert scaling.budgets(0) == scaling.minutes
    assert scaling.budgets(1) == (15, 30, 60)


def test_means_over_seeds():
    assert doctest.testmod(bench).failed == 0
    unknown = {metric: [None, None, None] for metric in bench.METRICS}
    points = [
        {"config": "a", "minutes": 1.0, "windows": 8, "scores": {"150": unknown}} for _ in range(2)
    ]
    assert bench.over_seeds(points) == [["a", 1, 150, 2, 8] + [None] * len(bench.METRICS)]


def test_cells():
    assert bench.rounded([1.23456, 1.0, 2.0]) == [1.235, 1.0, 2.0]
    assert bench.rounded([0.5, None, None]) == 0.5
    assert bench.rounded([float("nan"), None, None]) is None
