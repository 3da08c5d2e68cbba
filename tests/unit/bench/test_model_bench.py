"""The bench of systems with tiny networks: one command trains, dances, scores, writes, goes on."""

import json

import pytest

from dancediff.bench.model_bench import BARE, METRICS, TRUTH, ModelBench
from dancediff.bench.results import rows_of
from dancediff.cli import main
from dancediff.motion.motion import Motion

DATA = """
[data]
songs = 2
seconds = 6.0
workers = 1
dancers_per_batch = 4
[train]
steps = 4
warmup = 1
save_every = 2
[model]
"""
SMALL = "d_model = 16\nnum_heads = 2\nnum_layers = 1\nff_dim = 32\n"
SYSTEMS = {
    "tiny_edge": f'class = "EDGE"\n{SMALL}',
    "tiny_gcd": f'class = "GCD"\n{SMALL}extensions = ["preconditioning"]\n',
    "tiny_tcdiff": f'class = "TCDiff"\n{SMALL}path_width = 8\npath_layers = 1\n',
    "tiny_tcdiffpp": f"{SMALL}fusion_hidden = 32\n",
}
BUDGET = 0.4 / 60  # minutes


@pytest.fixture(scope="module")
def configs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("configs")
    for name, model in SYSTEMS.items():
        (folder / f"{name}.toml").write_text(DATA + model, encoding="utf-8")
    return [folder / f"{name}.toml" for name in SYSTEMS]


@pytest.fixture(scope="module")
def out(configs, tmp_path_factory):
    """A folder in which the command has run once."""
    out = tmp_path_factory.mktemp("bench")
    assert main(command(configs, out)) == 0
    return out


def command(configs, out, *seeds):
    words = ["bench-models", *map(str, configs), "--out", str(out), "--minutes", str(BUDGET)]
    words += ["--seeds", *(seeds or ("0",)), "--count", "3", "--songs", "6", "--steps", "2"]
    return [*words, "--json"]


def test_one_command_trains_dances_scores_and_draws(out):
    found = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert [point["config"] for point in found["points"]] == list(SYSTEMS)
    for point in found["points"]:
        scores = point["scores"]["150"]
        assert list(scores) == list(METRICS) and all(scores["FID_k"])
        assert 3 * point["step"] <= point["windows"] <= 5 * point["step"]
        assert point["spent"] == pytest.approx(60 * BUDGET, rel=0.8)  # steps are few and uneven
        folder = out / f"{point['config']}-0" / f"{BUDGET:g}min"
        assert (folder / "model" / "config.json").exists()
        made = Motion.load(next(folder.glob("dances-*/*.npz"))).meta
        assert (made["steps"], made["sampler"], made["kind"]) == (2, "ddim", "generated")
        assert not any(made.get(name) for name in BARE if BARE[name] is False)
    table = (out / "results.md").read_text(encoding="utf-8")
    assert all(f"| {name}, {BUDGET:g} min, 150 frames |" in table for name in SYSTEMS)
    assert f"| {TRUTH}, 150 frames |" in table and "GMR ↓" in table
    for name in ("quality.png", "filmstrips.png"):
        assert (out / name).stat().st_size > 10_000


def test_what_is_done_is_not_done_again(out, configs, capsys):
    files = [*out.rglob("*.npz"), *out.rglob("config.json"), *out.rglob("point.json")]
    before = {path: path.stat().st_mtime_ns for path in files}
    assert main(command(configs, out)) == 0
    assert {path: path.stat().st_mtime_ns for path in files} == before
    assert len(json.loads(capsys.readouterr().out)["rows"]) == 5
    assert main(command(configs[:1], out, "0", "1")) == 0  # a second seed of one system
    row = json.loads(capsys.readouterr().out)["rows"][0]["scores"]["GMR"]
    assert row["low"] < row["value"] < row["high"]
    assert {path: path.stat().st_mtime_ns for path in files} == before


def test_other_windows_are_scored_anew(out, configs):
    bench = ModelBench(configs[:1], out, minutes=(BUDGET,), seeds=(0,), count=2, songs=6, steps=2)
    (point,) = bench.points()
    assert point["how"]["count"] == 2 and len(bench.windows(150)) == 2


@pytest.mark.parametrize("kind", ["Lodge", "FACT"])
def test_systems_that_are_trained_in_stages_are_refused(kind, tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(f'[model]\nclass = "{kind}"\n[train]\n', encoding="utf-8")
    with pytest.raises(ValueError, match=rf"a.toml'\: {kind} is trained in stages"):
        ModelBench([path], tmp_path)


def test_bad_arguments_are_told(tmp_path, capsys):
    assert main(["bench-models", "nothing_small", "--out", str(tmp_path / "out")]) == 2
    assert "'nothing_small' does not exist" in capsys.readouterr().err
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same.toml").write_text('[model]\nclass = "EDGE"\n[train]\n', "utf-8")
    paths = [str(tmp_path / folder / "same.toml") for folder in ("a", "b")]
    assert main(["bench-models", *paths, "--out", str(tmp_path / "out")]) == 2
    assert "have one name" in capsys.readouterr().err


def test_one_seed_keeps_its_bootstrap_interval_and_no_number_is_none():
    scores = {"150": {"GMR": [1.0, 0.5, 2.0], "BAS": [float("nan"), None, None]}}
    point = {"config": "a", "minutes": 5, "seed": 0, "weights": 1e6, "spent": 60, "windows": 1000}
    (row,) = rows_of([point | {"scores": scores}])
    assert (row["scores"]["GMR"]["low"], row["scores"]["GMR"]["high"]) == (0.5, 2.0)
    assert row["scores"]["BAS"]["value"] is None
    assert row["scores"]["million weights"]["value"] == 1.0
