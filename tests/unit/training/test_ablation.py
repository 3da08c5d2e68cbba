"""`dancediff.training.ablation` and its config and table."""

import json
import re
import sys
from functools import partial

import pytest
import torch

from dancediff import cli
from dancediff.data.choreographed import choreographed_takes, make_choreographed
from dancediff.data.prepare import prepare
from dancediff.data.take import Job
from dancediff.data.windows import WindowSampler
from dancediff.extensions.build import build as make
from dancediff.motion.motion import Motion
from dancediff.papers.edge.model import EDGE
from dancediff.papers.tcdiffpp.losses import LossWeights, tcdiffpp_losses
from dancediff.papers.tcdiffpp.model import TCDiffPP
from dancediff.training import ablation
from dancediff.training.ablation import run_ablation
from dancediff.training.ablation_config import CHOREOGRAPHER, read_ablation
from dancediff.training.ablation_data import (
    corpus,
    held_out_dances,
    held_out_orders,
    reference_dances,
)
from dancediff.training.ablation_table import mean_of_seeds
from dancediff.training.config import LARGEST_SEED
from dancediff.training.run import MODELS
from places import CONFIGS

TINY = CONFIGS / "ablate_tiny.toml"
BASE = """
[data]
songs = 1
seconds = 3.0
workers = 1
dancers_per_batch = 2
[model]
d_model = 16
num_heads = 2
num_layers = 1
ff_dim = 32
fusion_hidden = 32
num_frames = 30
without = ["ssm"]
[train]
steps = 4
save_every = 2
[held_out]
songs = 2
seconds = 3.0
dancers = 2
reference = 3
[sample]
steps = 2
overlap = 15
"""


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("ablate_*.toml")), ids=lambda p: p.stem)
def test_every_config_that_comes_with_the_package_can_be_read(path):
    variants = read_ablation(path)
    assert len({variant.name for variant in variants}) == len(variants) > 1


@pytest.fixture
def config(tmp_path):
    def write(variants, base=BASE):
        path = tmp_path / "a.toml"
        path.write_text(base + variants)
        return path

    return write


class Judge:
    """Stands in for the metrics; counts how often it is asked."""

    def __init__(self):
        self.asked = 0

    def __call__(self, dances, *, reference, songs):
        self.asked += 1
        assert len(dances) == len(songs) == 2 and len(reference) == 3
        assert all(song.duration == pytest.approx(3.0) for song in songs)
        assert {(d.num_dancers, d.num_frames) for d in [*dances, *reference]} == {(2, 90)}
        x = torch.stack([dance.root[..., 0].mean() for dance in dances])
        return {"x": {"value": x.mean().item(), "low": x.min().item(), "high": x.max().item()}}


def dances(out, name):
    files = sorted((out / "variants" / name).glob("*/dance_*.npz"))
    return torch.cat([Motion.load(path).features() for path in files])


@pytest.fixture(scope="module")
def tiny():
    return {variant.name: variant for variant in read_ablation(TINY)}


def build(variant):
    tables = json.loads(json.dumps(variant.tables["model"]))
    model_class, config_class = MODELS[tables.pop("class", "TCDiffPP")]
    torch.manual_seed(0)
    extensions = tables.pop("extensions")
    return make(model_class, config_class(**tables), extensions)


@pytest.mark.parametrize(
    ("name", "removed"),
    [
        ("no-FP", r"decoder\.fusion_projection\."),
        ("no-FA", r"footwork_adaptor\."),
        ("no-SD", r"decoder\.sequence_decoder\.layers\.\d\.(ssm|norms\.3|films\.3)\."),
        ("no-DPE", r"decoder\.dancer_positioning\."),
        ("no-SM", r"decoder\.swap_mode\."),
    ],
)
def test_a_switch_takes_its_part_away_and_nothing_else(tiny, name, removed):
    full, without = (set(build(tiny[k]).state_dict()) for k in ("full", name))
    gone = full - without
    assert gone and not without - full
    assert all(re.match(removed, key) for key in gone)
    assert not any(re.match(removed, key) for key in without)
    assert tiny[name].training != tiny["full"].training
    assert tiny[name].tables["weights"] == tiny["full"].tables["weights"]


def test_without_l_d_distances_cost_nothing(tiny):
    model = build(tiny["no-L_D"])
    assert build(tiny["full"]).config == model.config
    x = torch.rand(1, 2, 20, 151)
    totals = []
    for name in ("full", "no-L_D"):
        weights = LossWeights(**tiny[name].tables["weights"])
        terms = tcdiffpp_losses(x, x, 0.5 * x, model.normalizer, weights=weights)
        totals.append(terms["total"])
    assert terms["dist"] > 0
    torch.testing.assert_close(totals[0] - totals[1], 0.636 * terms["dist"])


def test_long_sampling_is_no_training(tiny):
    full, naive = tiny["full"], tiny["no-LGDS"]
    assert full.training == naive.training and full.dances_key != naive.dances_key
    assert (full.sample.long_sampling, naive.sample.long_sampling) == ("lgds", "naive")


def test_edge_keeps_the_sizes_that_both_have(tiny):
    edge, full = build(tiny["EDGE"]), build(tiny["full"])
    assert isinstance(edge, EDGE) and isinstance(full, TCDiffPP)
    for key in ("d_model", "num_heads", "num_layers", "ff_dim"):
        assert getattr(edge.config, key) == getattr(full.config, key)
    assert tiny["EDGE"].tables["train"] == tiny["full"].tables["train"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", r"has no \[variants.NAME\]"),
        ("[variants.a]\nmodel = {colour = 1}", "variant 'a': 'model' has no 'colour'"),
        ("[variants.a]\nsample = {colour = 1}", "variant 'a': 'sample': colour=1 is no option"),
        ("[variants.a]\ndata = {songs = 1}", "variant 'a' changes 'data', the same for all"),
        ("[variants.a]\nheld_out = {songs = 1}", "variant 'a' changes 'held_out'"),
        (
            "[variants.a]\nsample = {long_sampling = 'short'}",
            "long_sampling='short' is not one of 'lgds', 'naive'",
        ),
        ("[variants.a]\ntrain = {decay = 7}", "variant 'a': 'train': decay=7"),
        ("[variants.a]\nmodel = {class = 'GPT'}", "'GPT' is not one of TCDiffPP, EDGE"),
        (
            "[variants.a]\nmodel = {class = 'FACT'}",
            "'FACT' is not one of TCDiffPP, EDGE, GCD, TCDiff, Lodge, .* FACT, .* not ablated",
        ),
        ("[variants.a]\nmodel = 3", "'model' is no table"),
        ("[variants]\na = 3", "variant 'a' is no table"),
        ('[variants."a/b"]', "variant 'a/b' is no name"),
        (f"[variants.{CHOREOGRAPHER}]", f"variant '{CHOREOGRAPHER}' is no name"),
    ],
)
def test_config_mistakes_are_named(config, text, words):
    with pytest.raises(ValueError, match=words):
        read_ablation(config(text))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("songs = 1\n", "songs = 1_000_001\n", r"songs=1000001 of \[data\] must be at most"),
        ("reference = 3", "reference = 0", "reference=0 must be above 0"),
        ("dancers = 2", "dancers = 6", r"dancers=6 must lie in 1 \.\.\. 5"),
        ("songs = 2\nseconds = 3.0", "songs = 2\nseconds = 2", "seconds=2 must be at least 3"),
        ("[data]", "[date]\n[data]", "there is no table 'date'"),
    ],
)
def test_held_out_songs_are_held_out(config, old, new, words):
    with pytest.raises(ValueError, match=words):
        read_ablation(config("[variants.a]\n", BASE.replace(old, new)))


FOUR = """
[variants.full]
[variants.no-FP]
model = { without = ["ssm", "fusion_projection"] }
[variants.no-LGDS]
sample = { long_sampling = "naive" }
[variants.EDGE]
model = { class = "EDGE" }
"""


def test_rows_dances_and_what_is_done_stays_done(config, tmp_path, monkeypatch):
    out, judge, saved = tmp_path / "out", Judge(), []
    keep = lambda model, folder: saved.append((type(model).__name__, folder.parent.name))  # noqa: E731
    rows = run_ablation(config(FOUR), out, evaluate=judge, save=keep)
    assert [row["variant"] for row in rows] == [CHOREOGRAPHER, "full", "no-FP", "no-LGDS", "EDGE"]
    assert judge.asked == 5 and len({row["scores"]["x"]["value"] for row in rows}) == 5
    assert sorted(kind for kind, _ in saved) == ["EDGE", "TCDiffPP", "TCDiffPP"]
    assert len(list((out / "trainings").iterdir())) == 3  # no-LGDS shares that of full
    assert json.loads((out / "results.json").read_text()) == rows
    assert "| no-LGDS | " in (out / "results.md").read_text()
    metas = {
        name: Motion.load(next((out / "variants" / name).glob("*/dance_0.npz"))).meta
        for name in ("full", "no-LGDS", "EDGE")
    }
    assert "pinning" in metas["full"] and metas["no-LGDS"]["long_sampling"] == "naive"
    assert metas["EDGE"]["model"] == "edge"

    def never(*_, **__):
        raise AssertionError("trained again")

    monkeypatch.setattr(ablation, "train_from_config", never)
    assert run_ablation(config(FOUR), out, evaluate=judge) == rows and judge.asked == 5
    monkeypatch.undo()

    other = FOUR.replace('"ssm", ', '"ssm", "dancer_positioning", ')
    before = dances(out, "full")
    again = run_ablation(config(other), out, evaluate=judge)
    assert judge.asked == 6 and again[2]["scores"] != rows[2]["scores"]
    assert [again[i] for i in (0, 1, 3, 4)] == [rows[i] for i in (0, 1, 3, 4)]
    assert torch.equal(dances(out, "full"), before)


def test_groups_are_asked_for_the_orders_in_which_the_true_dances_end(config, tmp_path):
    base = BASE.replace("songs = 2\nseconds = 3.0", "songs = 6\nseconds = 5.0")
    path = config("[variants.full]\n[variants.asked]\nsample = {swap = [0, 1]}", base)
    run_ablation(path, tmp_path, evaluate=lambda dances, **_: {})
    variant = read_ablation(path)[0]
    orders = [list(order) for order in held_out_orders(variant)]
    assert [1, 0] in orders and [0, 1] in orders
    for name, expected in (("full", orders), ("asked", 6 * [[0, 1]])):
        folder = next((tmp_path / "variants" / name).glob("*/"))
        danced = [Motion.load(folder / f"dance_{i}.npz") for i in range(6)]
        assert [dance.meta["swap"] for dance in danced] == expected


def test_reference_dances_are_like_the_true_ones_and_to_other_songs(config):
    variant = read_ablation(config("[variants.full]"))[0]
    held_out, reference = held_out_dances(variant), reference_dances(variant)
    assert not set(variant.held_out.seeds) & set(variant.held_out.reference_seeds)
    assert (len(held_out), len(reference)) == (2, 3)
    made = choreographed_takes(variant.held_out.reference_seeds[1], seconds=3.0, sizes=(2,))
    assert torch.equal(reference[1].root, made[0].motion.root)


def test_the_table_is_there_before_the_last_training(config, tmp_path, monkeypatch):
    """Hours before the end one can read what is done, and only that."""
    out, rows = tmp_path / "out", run_ablation(config(FOUR), tmp_path / "whole", evaluate=Judge())
    run_job, seen = ablation._run_job, []

    def watched(job, *more):
        if (out / "results.json").exists():
            seen.append([row["variant"] for row in json.loads((out / "results.json").read_text())])
        return run_job(job, *more)

    monkeypatch.setattr(ablation, "_run_job", watched)
    assert run_ablation(config(FOUR), out, evaluate=Judge()) == rows
    assert seen == [[CHOREOGRAPHER, "full", "no-LGDS"], [CHOREOGRAPHER, "full", "no-FP", "no-LGDS"]]


def test_a_killed_run_goes_on_from_its_checkpoint(config, tmp_path, monkeypatch):
    path = config("[variants.full]\n")
    whole = run_ablation(path, tmp_path / "whole", evaluate=Judge())
    batch, steps = WindowSampler.batch, []

    def killed(self, step):
        if step == 3:
            raise KeyboardInterrupt
        return batch(self, step)

    def watched(self, step):
        steps.append(step)
        return batch(self, step)

    monkeypatch.setattr(WindowSampler, "batch", killed)
    with pytest.raises(KeyboardInterrupt):
        run_ablation(path, tmp_path / "parts", evaluate=Judge())
    assert not (tmp_path / "parts" / "results.json").exists()
    monkeypatch.setattr(WindowSampler, "batch", watched)
    assert run_ablation(path, tmp_path / "parts", evaluate=Judge()) == whole
    assert steps == [2, 3]  # the checkpoint was written after two steps
    assert torch.equal(dances(tmp_path / "parts", "full"), dances(tmp_path / "whole", "full"))

    first, second = sorted((tmp_path / "parts" / "variants" / "full").glob("*/dance_*.npz"))
    second.unlink()  # as if it had been killed between two dances
    before = first.stat().st_mtime_ns
    run_ablation(path, tmp_path / "parts", evaluate=Judge())
    assert first.stat().st_mtime_ns == before and steps == [2, 3]
    assert torch.equal(dances(tmp_path / "parts", "full"), dances(tmp_path / "whole", "full"))


def test_one_failure_does_not_stop_the_others(config, tmp_path):
    variants = """
[variants.wrong]
model = { extensions = [] }
sample = { order_constraint = true }
[variants.swap]
sample = { swap = [1, 0] }
[variants.broken]
train = { lr = 1e30, clip = 1e30, warmup = 0 }
"""
    rows = run_ablation(config(variants), tmp_path / "out", evaluate=Judge())
    assert rows[1]["failed"].startswith("dancing: order_constraint=True needs")
    assert "scores" in rows[2]
    assert rows[3]["failed"].startswith("training: the gradient of step")
    text = (tmp_path / "out" / "results.md").read_text()
    assert "| wrong | failed |" in text and "- broken failed; training" in text


def test_an_own_loss_that_fails_does_not_stop_the_others(config, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "failing_loss.py").write_text("def loss(c): return c.no_such_thing\n")
    extensions = '{ own_loss = "failing_loss:loss", own_loss_weight = 0.1 }'
    path = config(f"[variants.own]\nextensions = {extensions}\n[variants.full]\n")
    rows = run_ablation(path, tmp_path / "out", evaluate=Judge())
    said = "training: own_loss='failing_loss:loss' fails: AttributeError: "
    assert rows[1]["failed"].startswith(said) and "scores" in rows[2]


def test_nothing_can_be_asked_of_dancers_who_do_not_see_each_other(config, tmp_path):
    asked = '[variants.asked]\nmodel = { class = "EDGE" }\nsample = { swap = [1, 0] }\n'
    with pytest.raises(ValueError, match=r"'asked': 'sample': swap=\[1, 0\] is not for"):
        run_ablation(config(asked), tmp_path / "out", evaluate=Judge())
    (variant,) = read_ablation(config(asked.replace("[1, 0]", "[]")))
    assert "swap" not in variant.sample.names()


def test_bad_devices_are_named_before_anything_is_done(config, tmp_path):
    for devices, words in ((("cpu", "toaster"), "device='toaster'"), ((), "devices is empty")):
        with pytest.raises(ValueError, match=words):
            run_ablation(config(FOUR), tmp_path / "out", devices=devices, evaluate=Judge())
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_side_by_side_is_the_same(config, tmp_path):
    path = config(
        '[variants.full]\n[variants.no-FP]\nmodel = { without = ["ssm", "fusion_projection"] }\n'
    )
    one = run_ablation(path, tmp_path / "one", evaluate=Judge())
    two = run_ablation(path, tmp_path / "two", evaluate=Judge(), devices=("cpu", "cpu"))
    assert [row["variant"] for row in one] == [row["variant"] for row in two]
    for name in ("full", "no-FP"):
        a, b = (dances(tmp_path / k, name) for k in ("one", "two"))
        torch.testing.assert_close(a, b, atol=1e-4, rtol=0)


def test_command_line(config, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(ablation, "metric_scores", Judge())
    args = ["ablate", str(config("[variants.full]\n")), "--out", "out"]
    assert cli.main(args) == 0
    text = capsys.readouterr().out
    assert "| full | " in text and "results.md" in text
    training = json.loads((tmp_path / "out" / "results.json").read_text())[1]["training"]
    assert (tmp_path / "out" / "trainings" / training / "model" / "model.safetensors").exists()
    assert cli.main([*args, "--json"]) == 0
    assert [row["variant"] for row in json.loads(capsys.readouterr().out)["rows"]] == [
        CHOREOGRAPHER,
        "full",
    ]
    assert cli.main([*args, "--devices", "toaster"]) == 2
    assert "device='toaster'" in capsys.readouterr().err
    assert cli.main(["ablate", "missing.toml"]) == 2
    assert "'missing.toml' does not exist" in capsys.readouterr().err


def test_every_variant_is_trained_and_sampled_with_every_seed(config):
    path = config("[variants.full]\n[variants.naive]\nsample = {long_sampling = 'naive'}\n")
    path.write_text("seeds = [3, 5]\n" + path.read_text())
    variants = read_ablation(path)
    assert [v.name for v in variants] == [
        f"{name}-seed-{seed}" for seed in (3, 5) for name in ("full", "naive")
    ]
    assert [v.tables["train"]["seed"] for v in variants] == [3, 3, 5, 5]
    assert variants[0].training == variants[1].training != variants[2].training
    assert variants[0].sample.seed != variants[2].sample.seed
    assert {v.of for v in variants} == {"full", "naive"}


@pytest.mark.parametrize(
    "seeds", ["[]", "[1, 1]", "['a']", "3", "[0.5]", "[true]", "[-1]", f"[{LARGEST_SEED}]"]
)
def test_seeds_that_are_none_are_refused(config, seeds):
    path = config("[variants.full]\n")
    path.write_text(f"seeds = {seeds}\n" + path.read_text())
    with pytest.raises(ValueError, match=r"a\.toml': seeds=.* whole numbers in 0 \.\.\. "):
        read_ablation(path)


def test_the_table_has_one_row_for_all_seeds(config, tmp_path):
    path = config("[variants.full]\n")
    path.write_text("seeds = [0, 1]\n" + path.read_text())
    rows = run_ablation(path, tmp_path / "out", evaluate=Judge())
    values = [row["scores"]["x"]["value"] for row in rows[1:]]
    assert len(values) == 2 and values[0] != values[1]
    lines = (tmp_path / "out" / "results.md").read_text().splitlines()
    mean, low, high = (f"{v:.3g}" for v in (sum(values) / 2, min(values), max(values)))
    assert lines[3] == f"| full | {mean} [{low}, {high}] |" and len(lines) == 4


def test_a_seed_that_failed_is_left_out():
    good = {"variant": "a-1", "of": "a", "scores": {"x": {"value": 2.0}}}
    bad = {"variant": "a-0", "of": "a", "failed": "training: no luck"}
    assert mean_of_seeds([bad, good])[0]["scores"]["x"]["value"] == 2.0
    assert mean_of_seeds([bad])[0]["failed"] == "training: no luck"


def test_metrics_that_only_some_seeds_have_are_means_of_those():
    """Such as swap obedience, of dances in which somebody is asked to change places."""
    seeds = [{"x": 1.0}, {"x": 3.0, "swap": 0.5}, {"x": None, "swap": None}]
    rows = [
        {
            "variant": f"a-{k}",
            "of": "a",
            "scores": {name: {"value": value, "arrow": "up"} for name, value in seed.items()},
        }
        for k, seed in enumerate(seeds)
    ]
    (mean,) = mean_of_seeds(rows)
    assert list(mean["scores"]) == ["x", "swap"]
    assert mean["scores"]["x"] == {"value": 2.0, "low": 1.0, "high": 3.0, "arrow": "up"}
    assert mean["scores"]["swap"] == {"value": 0.5, "low": 0.5, "high": 0.5, "arrow": "up"}
    assert list(mean_of_seeds(rows[::-1])[0]["scores"]) == ["x", "swap"]


OWN = """
from dataclasses import dataclass

from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig


@dataclass(frozen=True)
class ShortConfig(TCDiffPPConfig):
    num_frames: int = 30


class Short(TCDiffPP):
    config_class = ShortConfig
"""


def test_a_network_of_ones_own_is_trained(config, tmp_path, monkeypatch):
    (tmp_path / "ablated_network.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    base = BASE.replace("num_frames = 30\n", "")
    path = config('[variants.own]\nmodel = { class = "ablated_network:Short" }\n', base)
    assert len(corpus(read_ablation(path)[0], tmp_path / "out")) == 5  # one song, five sizes
    assert "scores" in run_ablation(path, tmp_path / "out", evaluate=Judge())[1]


OF_MINE = """
[variants.class]
model = { class = "ablated_code:Short" }
[variants.loss]
extensions = { own_loss = "ablated_code:loss", own_loss_weight = 0.1 }
[variants.sampler]
sample = { sampler = "ablated_code:step" }
[variants.plain]
"""


def test_what_a_change_of_ones_own_code_touches_is_done_anew(config, tmp_path, monkeypatch):
    """It was shown as the result of the new code."""
    monkeypatch.syspath_prepend(tmp_path)
    code = f"{OWN}def loss(c): return c.x_hat.mean()\ndef step(*x, **y): return x[0]\n"
    base = BASE.replace("[held_out]", '[held_out]\nmetrics = ["ablated_metric:width"]')
    path = config(OF_MINE, base)

    def keys(metric, code):
        for name, text in (("ablated_metric", metric), ("ablated_code", code)):
            (tmp_path / f"{name}.py").write_text(text)
            monkeypatch.delitem(sys.modules, name, raising=False)
        kinds = ("training", "dances_key", "scores_key")
        return {v.name: [getattr(v, kind) for kind in kinds] for v in read_ablation(path)}

    metric = "def width(joints, *, fps): return 1.0\n"
    before = keys(metric, code)
    assert keys(metric, code) == before
    other, measured = keys(metric, f"{code}# changed\n"), keys(f"{metric}# changed\n", code)
    kept = {name: [old in other[name] for old in before[name]] for name in before}
    assert kept["class"] == kept["loss"] == [False, False, False]
    assert kept["sampler"] == [True, False, False] and kept["plain"] == [True, True, True]
    for name, (training, dances_key, scores_key) in measured.items():
        assert [training, dances_key] == before[name][:2] and scores_key != before[name][2]


def test_a_longer_network_learns_from_its_own_takes(config, tmp_path, monkeypatch):
    """A short take is for a short network only, whoever comes first in the config."""
    jobs = [
        Job(f"choreographed_{seed:06d}_2", partial(make_choreographed, seed, 2, seconds=seconds))
        for seed, seconds in enumerate((3.0, 6.0))
    ]
    prepare(jobs, tmp_path / "data", progress=False)
    seen = []

    def watched(*_, takes, **__):
        seen.append(sorted(take.num_frames for take in takes))
        raise ValueError("seen")

    monkeypatch.setattr(ablation, "train_from_config", watched)
    base = BASE.replace("[data]", f'[data]\nfolder = "{tmp_path / "data"}"')
    path = config("[variants.short]\n[variants.long]\nmodel = { num_frames = 120 }\n", base)
    with pytest.warns(UserWarning, match="of 2 takes to train on are left out: 1 shorter than 120"):
        run_ablation(path, tmp_path / "out", evaluate=Judge())
    assert seen == [[90, 180], [180]]


@pytest.mark.parametrize(
    "changed", ["start = [[0, 0], [1, 0]]", "end = [[0, 0], [1, 0]]", "energy = [0.1, 0.9, 0.1]"]
)
def test_dances_asked_for_otherwise_are_others(config, changed):
    plain, other, there = read_ablation(
        config(
            f"[variants.plain]\n[variants.other]\nsample = {{ {changed} }}\n"
            "[variants.there]\nsample = { device = 'cpu' }\n"
        )
    )
    assert plain.dances_key != other.dances_key and plain.training == other.training
    assert plain.dances_key == there.dances_key


def constant(dances, *, reference, songs):
    return {"x": {"value": 7.0, "low": None, "high": None}}


def test_another_judge_is_asked_anew(config, tmp_path):
    path, judge = config("[variants.full]\n"), Judge()
    first = run_ablation(path, tmp_path / "out", evaluate=judge)
    second = run_ablation(path, tmp_path / "out", evaluate=constant)
    assert [row["scores"]["x"]["value"] for row in second] == [7.0, 7.0]
    assert run_ablation(path, tmp_path / "out", evaluate=judge) == first and judge.asked == 4


def test_another_network_keeps_the_weights_that_both_have(config):
    base = BASE + "[weights]\nsimple = 0.5\ndist = 0.3\n"
    (gcd,) = read_ablation(config('[variants.gcd]\nmodel = { class = "GCD" }\n', base))
    assert gcd.tables["weights"] == {"simple": 0.5}
    asked = '[variants.gcd]\nmodel = { class = "GCD" }\nweights = { dist = 0.3 }\n'
    with pytest.raises(ValueError, match="'weights' has no 'dist'"):
        read_ablation(config(asked))


def test_another_network_keeps_the_extensions_of_training_that_both_have(config):
    base = BASE + "[extensions]\nmusic_dropout = 0.2\nown_overlap = 0.25\n"
    full, gcd = read_ablation(
        config('[variants.full]\n[variants.gcd]\nmodel = { class = "GCD" }\n', base)
    )
    assert full.tables["extensions"] == {"music_dropout": 0.2, "own_overlap": 0.25}
    assert gcd.tables["extensions"] == {"music_dropout": 0.2}


def test_extensions_that_are_no_list_are_told_for_another_network_too(config):
    base = BASE.replace("[model]", "[model]\nextensions = 3")
    with pytest.raises(ValueError, match="extensions=3 should be a list"):
        read_ablation(config('[variants.gcd]\nmodel = { class = "GCD" }\n', base))
