"""The bench of systems with tiny networks: one command trains, dances, scores, writes, goes on."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import torch

from dancediff import hub
from dancediff.bench.budget import NO_EVALUATION, Run, last_line, write_config
from dancediff.bench.model_bench import METRICS, ModelBench
from dancediff.bench.results import rows_of
from dancediff.bench.scores import scores_of
from dancediff.bench.stages import StagedRun, stage_shares
from dancediff.cli import main
from dancediff.data.choreographed import choreograph_jobs, make_choreographed
from dancediff.data.prepare import prepare
from dancediff.data.take import Job
from dancediff.genre import GENRES
from dancediff.motion.motion import Motion
from dancediff.papers.edge.model import SPACING
from dancediff.training.config import TrainConfig
from dancediff.training.tables import read_training

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
        assert (made["foot_contact"], made["frequency_clip"]) == (False, False)
        assert not any(made.get(name) for name in ("collision_avoidance", "order_constraint"))
    table = (out / "results.md").read_text(encoding="utf-8")
    assert all(f"| {name}, {BUDGET:g} min, 150 frames |" in table for name in SYSTEMS)
    assert "| held-out dances, 150 frames |" in table and "GMR ↓" in table
    assert "| mean pose, 150 frames |" in table and "| shuffled frames, 150 frames |" in table
    group = json.loads((out / "papers.json").read_text(encoding="utf-8"))["tcdiffpp"]
    assert [row[1] for row in group[:4]] == ["EDGE", "GCD", "TCDiff", "TCDiffPP"]
    gmr = {row[1]: row[4][0] for row in group[:4]}
    assert gmr["EDGE"] == found["points"][0]["scores"]["150"]["GMR"][0]
    assert "TCDiff++, table 1 (AIOZ-GDance" in (out / "papers.md").read_text(encoding="utf-8")
    for name in ("quality.png", "filmstrips.png"):
        assert (out / name).stat().st_size > 10_000


def test_what_is_done_is_not_done_again(out, configs, capsys):
    files = [*out.rglob("*.npz"), *out.rglob("config.json"), *out.rglob("point.json")]
    before = {path: path.stat().st_mtime_ns for path in files}
    assert main(command(configs, out)) == 0
    assert {path: path.stat().st_mtime_ns for path in files} == before
    assert len(json.loads(capsys.readouterr().out)["rows"]) == 7
    assert main(command(configs[:1], out, "0", "1")) == 0  # a second seed of one system
    row = json.loads(capsys.readouterr().out)["rows"][0]["scores"]["GMR"]
    assert row["low"] < row["value"] < row["high"]
    assert {path: path.stat().st_mtime_ns for path in files} == before


def test_budgets_of_windows_stand_beside_those_of_time(out, configs, tmp_path):
    fact = tmp_path / "tiny_fact.toml"
    fact.write_text(STAGED["tiny_fact"], encoding="utf-8")
    given = {"held": out / "held", "other": out / "reference", "count": 3, "steps": 2}
    bench = ModelBench(
        [configs[0], fact],
        tmp_path / "out",
        minutes=(),
        given_windows=(40, 80),
        seeds=(0,),
        **given,
    )
    points = list(bench.points())
    assert [point["given_windows"] for point in points] == [40, 80, 40, 80]
    for point in points:  # a step more or less, of four dancers or a few more
        assert point["windows"] == pytest.approx(point["given_windows"], abs=10)
        assert bench.branch(point).parent.name == "windows"
        assert (bench.branch(point) / "model" / "config.json").exists()
    again = list(bench.points())
    assert again == points
    rows = rows_of(points)
    assert rows[0]["variant"] == "tiny_edge, 40 windows, 150 frames"


def test_of_two_configs_of_a_class_the_first_stands_for_it(configs, tmp_path):
    other = tmp_path / "other_edge.toml"
    other.write_text(DATA + SYSTEMS["tiny_edge"], encoding="utf-8")
    bench = ModelBench([*configs, other], tmp_path)
    assert "other_edge" not in bench.systems and bench.systems["tiny_edge"] == "EDGE"
    assert bench.systems["tiny_tcdiffpp"] == "TCDiffPP"  # it names no class


def test_other_windows_are_scored_anew(out, configs):
    bench = ModelBench(configs[:1], out, minutes=(BUDGET,), seeds=(0,), count=2, songs=6, steps=2)
    (point,) = bench.points()
    assert point["how"]["count"] == 2 and len(bench.windows(150)) == 2


CODES = "width = 16\ncode_dim = 8\nnum_codes = 16\nlength = 7\n"
LODGE = """
[data]
songs = 3
seconds = 12.0
workers = 1
windows_per_batch = 2
global_windows_per_batch = 2
[global_stage]
{small}music_frames = 256
local_frames = 64
[local_stage]
{small}num_frames = 64
style_noise = 16
genres = {genres}
[train]
steps = 4
warmup = 1
save_every = 2
[train_fine_tune]
steps = 2
[model]
class = "Lodge"
"""
STAGED = {
    "tiny_fact": f'{DATA}class = "FACT"\n{SMALL}',
    "tiny_bailando": f'{DATA}class = "Bailando"\n{SMALL}head_layers = 1\n{CODES}',
    "tiny_codancers": f'{DATA}class = "CoDancers"\n{SMALL}{CODES}',
    "tiny_lodge": LODGE.format(small=SMALL, genres=list(GENRES)),
}
STAGES = {
    "tiny_fact": {"train": 1.0},
    "tiny_bailando": {"units": 1 / 3, "gpt": 1 / 3, "actor_critic": 1 / 3},
    "tiny_codancers": {"units": 1 / 2, "gpt": 1 / 2},
    "tiny_lodge": {"global": 0.4, "local": 0.4, "fine_tune": 0.2},
}


@pytest.fixture(scope="module")
def staged(out, tmp_path_factory):
    """The bench of systems that are trained in stages, and its points."""
    folder = tmp_path_factory.mktemp("staged")
    for name, text in STAGED.items():
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    bench = ModelBench(
        [folder / f"{name}.toml" for name in STAGED],
        folder / "out",
        held=out / "held",
        other=out / "reference",
        minutes=(1 / 60,),
        seeds=(0,),
        count=3,
        steps=2,
    )
    return bench, list(bench.points())


def test_windows_of_real_dances_are_danced(configs, tmp_path):
    """They were passed over, and the error told to prepare longer takes."""

    def job(split):
        take = make_choreographed(1, 1, seconds=5.0)
        return replace(take, kind="real", split=split)

    name = job("val").name
    for split, said in (("val", None), ("train", "real ones outside its training split")):
        prepare([Job(name, partial(job, split))], tmp_path / split, progress=False)
        bench = ModelBench(configs[:1], tmp_path, held=tmp_path / split)
        if said is None:
            assert [window.kind for window in bench.windows(150)] == ["real"]
        else:
            with pytest.raises(ValueError, match=said):
                bench.windows(150)


def test_stages_share_a_budget_as_they_share_the_steps(staged):
    bench, points = staged
    assert [point["config"] for point in points] == list(STAGED)
    for point in points:
        branch = bench.out / f"{point['config']}-0" / f"{1 / 60:g}min"
        shares = STAGES[point["config"]]
        spent = {stage: last_line(branch / stage) for stage in shares}
        for stage, share in shares.items():
            left = json.loads((branch / stage / "left.json").read_text(encoding="utf-8"))
            assert spent[stage]["step"] == left["steps"]
            assert left["decay"] == pytest.approx(0.2, abs=0.5 / left["steps"] ** 0.5)
            assert spent[stage]["spent"] > 0.8 * share  # of one second
            usual = 2 if point["config"] == "tiny_lodge" else 4  # windows, or dancers, a step
            assert abs(spent[stage]["windows"] / spent[stage]["step"] - usual) <= 0.5
        for name in ("spent", "windows", "step"):
            assert point[name] == pytest.approx(sum(one[name] for one in spent.values()))


def test_each_dancer_of_a_solo_system_dances_alone(staged):
    bench, _ = staged
    groups = [w for w in bench.windows(150) if w.motion.num_dancers > 1]
    assert groups
    dances = bench.dances(bench.out / "tiny_lodge-0" / f"{1 / 60:g}min", 150)
    dance = Motion.load(next(path for path in dances if path.stem == groups[0].name))
    assert dance.num_dancers == groups[0].motion.num_dancers
    gaps = dance.root[1:, 0, 0] - dance.root[:-1, 0, 0]
    assert torch.allclose(gaps, torch.tensor(SPACING), atol=1e-4)
    assert (dance.pose[1] - dance.pose[0]).abs().max() > 0.01


def test_a_stage_that_was_stopped_goes_on(staged, tmp_path, monkeypatch):
    bench, _ = staged
    config = bench.configs[list(STAGED).index("tiny_codancers")]
    run = StagedRun(config, 0, tmp_path, None)
    with monkeypatch.context() as m, pytest.raises(RuntimeError, match="stopped"):
        m.setattr(hub, "save_model", _stop)
        list(run.models((1 / 60,)))
    branch = tmp_path / f"{1 / 60:g}min"
    before = (branch / "gpt" / "losses.csv").read_bytes()
    ((_, model),) = run.models((1 / 60,))
    assert (model / "model" / "config.json").exists()
    assert (branch / "gpt" / "losses.csv").read_bytes() == before  # nothing was trained again


def _stop(*args, **options):
    raise RuntimeError("stopped")


def test_a_stage_needs_its_number_of_steps():
    with pytest.raises(ValueError, match="steps of the stage 'units' are missing"):
        stage_shares({"model": {"class": "CoDancers"}, "train": {}})


def test_bad_arguments_are_told(tmp_path, capsys):
    assert main(["bench-models", "nothing_small", "--out", str(tmp_path / "out")]) == 2
    assert "'nothing_small' does not exist" in capsys.readouterr().err
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same.toml").write_text('[model]\nclass = "EDGE"\n[train]\n', "utf-8")
    paths = [str(tmp_path / folder / "same.toml") for folder in ("a", "b")]
    assert main(["bench-models", *paths, "--out", str(tmp_path / "out")]) == 2
    assert "have one name" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("empty", "words"),
    [
        ({"configs": []}, "configs is empty; name at least one, such as gcd_tiny"),
        ({"seeds": ()}, "seeds is empty; name at least one, such as 0"),
        ({"frames": ()}, "frames is empty; name at least one, such as 150"),
        ({"minutes": ()}, "minutes and windows are empty; name a budget"),
        ({"count": 0}, "count=0 must be at least 1"),
    ],
)
def test_empty_options_are_told(configs, tmp_path, empty, words):
    with pytest.raises(ValueError, match=words):
        ModelBench(**{"configs": configs, "out": tmp_path} | empty)


@pytest.mark.parametrize("name", ["held", "other"])
def test_data_that_cannot_be_scored_is_told_before_training(
    out, configs, tmp_path, monkeypatch, name
):
    def never(*_):
        raise AssertionError("trained")

    monkeypatch.setattr(Run, "models", never)
    frames, folder = (150,), tmp_path / "none"
    words = "'.*none' is no folder of prepared data" if name == "held" else "none' does not exist"
    given = {"held": out / "held", "other": out / "reference"} | {name: folder}
    with pytest.raises(ValueError, match=words):
        next(ModelBench(configs, tmp_path, frames=frames, **given).points())
    if name == "held":
        given, frames = given | {name: out / "held"}, (1000,)
        words = "held='.*held' has no window of 1000 frames with music.* or ask for fewer frames"
        with pytest.raises(ValueError, match=words):
            next(ModelBench(configs, tmp_path, frames=frames, **given).points())


def test_no_dance_has_no_scores():
    with pytest.raises(ValueError, match="there are no dances to measure: the list is empty"):
        scores_of([], [], [])


def test_other_data_of_the_same_names_is_danced_and_scored_anew(out, configs, tmp_path):
    """Windows are called after their songs: those of another folder may have the same names."""
    prepare(choreograph_jobs(6, seconds=8.0, seed=500_000), tmp_path / "held", progress=False)
    given = {"minutes": (BUDGET,), "seeds": (0,), "count": 3, "songs": 6, "steps": 2}
    usual = ModelBench(configs[:1], out, **given)
    benches = [
        usual,
        ModelBench(configs[:1], out, held=tmp_path / "held", **given),
        ModelBench(configs[:1], out, other=out / "held", **given),
    ]
    own, held, other = (next(bench.points())["scores"]["150"] for bench in benches)
    assert own["MMC"] != held["MMC"] and own["FID_k"] != held["FID_k"]
    assert own["MMC"] == other["MMC"] and own["FID_k"] != other["FID_k"]
    assert next(usual.points())["scores"]["150"]["FID_k"] == own["FID_k"]


def test_a_training_with_a_budget_evaluates_nothing(tmp_path):
    source = tmp_path / "a.toml"
    evaluated = "evaluate_every = 2\npatience = 3\n"
    source.write_text(
        f'[model]\nclass = "Lodge"\n[train]\nmetrics_every = 4\n{evaluated}'
        f"[train_local]\nsteps = 2\n{evaluated}",
        encoding="utf-8",
    )
    tables = read_training(write_config(tmp_path / "new" / "b.toml", source, seed=5))
    assert tables["train"] == NO_EVALUATION | {"seed": 5}
    assert tables["train_local"] == NO_EVALUATION | {"steps": 2}
    TrainConfig(**tables["train"])


def test_one_seed_keeps_its_bootstrap_interval_and_no_number_is_none():
    scores = {"150": {"GMR": [1.0, 0.5, 2.0], "BAS": [float("nan"), None, None]}}
    point = {"config": "a", "minutes": 5, "seed": 0, "weights": 1e6, "spent": 60, "windows": 1000}
    (row,) = rows_of([point | {"scores": scores}])
    assert (row["scores"]["GMR"]["low"], row["scores"]["GMR"]["high"]) == (0.5, 2.0)
    assert row["scores"]["BAS"]["value"] is None
    assert row["scores"]["million weights"]["value"] == 1.0


def test_a_bad_config_is_told_by_its_own_name_before_anything_is_made(configs, tmp_path, capsys):
    typo = tmp_path / "typo.toml"
    typo.write_text('[model]\nclass = "EDGE"\n[train]\nstepz = 5\n', encoding="utf-8")
    stages = tmp_path / "stages.toml"
    stages.write_text('[model]\nclass = "CoDancers"\n[train]\nwarmup = 1\n', encoding="utf-8")
    out = tmp_path / "out"
    for config, words in (
        (typo, f"{str(typo)!r}: 'train' has no 'stepz'"),
        (stages, "steps"),
        ("ablate_tiny", "there is no table 'held_out'"),
    ):
        args = [str(configs[0]), str(config), "--out", str(out)]
        assert main(["bench-models", *args]) == 2
        said = capsys.readouterr().err
        assert words in said and Path(str(config)).stem in said
        assert not out.exists()
