"""`dancediff.training.run`, and the loop on real windows."""

import csv
import json

import pytest
import torch

from dancediff import hub
from dancediff.data.choreographed import choreographed_takes
from dancediff.data.take import DanceTake
from dancediff.data.windows import GroupCut, WindowSampler
from dancediff.extensions.build import build
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.motion.mirror import mirror_features
from dancediff.music.features import CHROMA
from dancediff.papers.codancers.model import CoDancers, CoDancersConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.config import GroupData, TrainConfig, TrainingExtensions
from dancediff.training.group_takes import windows_of
from dancediff.training.run import read_config, train_from_config
from dancediff.training.statistics import fit_statistics, take_over
from dancediff.training.trainer import Trainer
from places import CONFIGS

TINY = {
    "d_model": 32,
    "num_layers": 1,
    "num_heads": 2,
    "ff_dim": 64,
    "fusion_hidden": 64,
    "num_frames": 30,
}


@pytest.fixture(scope="module")
def takes():
    return choreographed_takes(0, seconds=6.0, sizes=(1, 2))


def logged(folder):
    return list(csv.DictReader((folder / "losses.csv").read_text().splitlines()))


def fresh(takes):
    torch.manual_seed(3)
    model = TCDiffPP(TCDiffPPConfig(**TINY))
    fit_statistics(model, takes)
    return model, WindowSampler(takes, GroupCut(30), dancers_per_batch=4)


def test_a_stopped_run_goes_on_as_if_nothing_had_happened(takes, tmp_path):
    config = TrainConfig(steps=6, warmup=2, save_every=3)
    model, data = fresh(takes)
    whole = Trainer(model, data, config, tmp_path / "whole").run()
    model, data = fresh(takes)

    class Stop:
        def batch(self, step):
            if step == 4:
                raise KeyboardInterrupt
            return data.batch(step)

    with pytest.raises(KeyboardInterrupt):
        Trainer(model, Stop(), config, tmp_path / "parts").run()
    model, data = fresh(takes)  # a new process
    parts = Trainer(model, data, config, tmp_path / "parts", resume=True).run()
    for name, value in whole.state_dict().items():
        assert torch.equal(parts.state_dict()[name], value), name
    last = [logged(tmp_path / k)[-1]["total"] for k in ("whole", "parts")]
    assert last[0] == last[1]


def test_losses_are_logged_by_name(takes, tmp_path):
    model, data = fresh(takes)
    Trainer(model, data, TrainConfig(steps=2, save_every=2), tmp_path).run()
    rows = logged(tmp_path)
    assert len(rows) == 2 and {
        "simple",
        "vel",
        "fk",
        "contact",
        "dist",
        "total",
        "lr",
        "gradient",
    } <= set(rows[0])
    assert not list(tmp_path.glob(".*"))  # no temporary file stays


def test_scales_of_a_training_with_mirror_images_hold_them(takes):
    """Else guesses of mirrored dances would be cut at the range of the others."""
    outside = {}
    for mirror in (False, True):
        model = TCDiffPP(TCDiffPPConfig(**TINY))
        fit_statistics(model, takes, mirror=mirror)
        images = torch.cat([mirror_features(take.x).flatten(0, 1) for take in takes])
        outside[mirror] = model.normalizer.normalize(images).abs().max().item()
    assert outside[False] > 1.05 and outside[True] < 1 + 1e-5


def test_without_chroma_another_harmony_changes_nothing(takes):
    torch.manual_seed(3)
    model = TCDiffPP(TCDiffPPConfig(**TINY))
    M = takes[0].M[:30]
    other = M.clone()
    other[:, CHROMA] = other[:, CHROMA].flip(1)
    change = {}
    for masked in ((), ("chroma",)):
        fit_statistics(model, takes, TrainingExtensions(masked_music=masked))
        heard = model.music_normalizer.normalize
        change[masked] = (heard(M) - heard(other)).abs().max()
    assert change[()] > 1 and change["chroma",] < 1e-4
    started = TCDiffPP(model.config)
    fit_statistics(started, takes, start=model)
    assert torch.equal(started.music_normalizer.std, model.music_normalizer.std)
    fit_statistics(model, takes)
    extensions = TrainingExtensions(masked_music=("chroma",))
    fit_statistics(started, takes, extensions, start=model)  # a start that does not mask it
    assert (started.music_normalizer.normalize(M) - heard(M)).abs().max() < 1e-4


def test_bf16_runs(takes, tmp_path):
    model, data = fresh(takes)
    ema = Trainer(model, data, TrainConfig(steps=2, precision="bf16"), tmp_path).run()
    assert all(p.isfinite().all() and p.dtype == torch.float32 for p in ema.parameters())


@pytest.mark.parametrize("faster", [torch.float32, torch.bfloat16])
def test_fastest_takes_what_is_faster_here(takes, tmp_path, monkeypatch, faster):
    monkeypatch.setattr("dancediff.training.objective.fastest_dtype", lambda kind: faster)
    named = {torch.float32: "fp32", torch.bfloat16: "bf16"}[faster]

    def weights(precision):
        model, data = fresh(takes)
        ema = Trainer(
            model, data, TrainConfig(steps=2, precision=precision), tmp_path / precision
        ).run()
        return torch.cat([p.detach().flatten() for p in ema.parameters()])

    assert torch.equal(weights("fastest"), weights(named))


def test_config_mistakes_are_named(tmp_path):
    path = tmp_path / "c.toml"
    both = "[model]\n[train]\n"
    for text, word in (
        ("", r"no table \[model\]"),
        ("[model]\n", r"no table \[train\]"),
        ("[train]\n[model]\ncolour=1", "colour"),
        (both + "[moodel]\n", "moodel"),
        ("a=[", "TOML"),
        ("a=" + 5000 * "[", "nested too deeply"),
    ):
        path.write_text(text)
        with pytest.raises(ValueError, match=word):
            read_config(path)
    with pytest.raises(ValueError, match="does not exist"):
        read_config(tmp_path / "none.toml")


def test_train_from_config(takes, tmp_path):
    path = tmp_path / "c.toml"
    model = "\n".join(f"{k} = {v}" for k, v in TINY.items())
    path.write_text(f"[model]\n{model}\n[train]\nsteps = 2\n[data]\ndancers_per_batch = 2\n")
    trained = train_from_config(path, tmp_path / "run", takes=takes)
    with pytest.raises(ValueError, match="holds a training"):
        train_from_config(path, tmp_path / "run", takes=takes)
    assert trained.config.d_model == 32 and (tmp_path / "run" / "checkpoint.safetensors").exists()


HELD_OUT = """[data]
songs = 1
held_out = 1
seconds = 6.0
varied = false
workers = 1
dancers_per_batch = 2
"""


def test_takes_that_are_given_are_evaluated_on_held_out_songs(takes, tmp_path):
    """Before there was no validation then, and no word of it."""
    sizes = "\n".join(f"{key} = {value}" for key, value in TINY.items())
    steps = "[train]\nsteps = 2\nevaluate_every = 1\nmetrics_every = 2\n"
    path = tmp_path / "c.toml"
    path.write_text(f"{HELD_OUT}[model]\n{sizes}\n{steps}")
    train_from_config(path, tmp_path / "run", takes=takes)
    assert all(float(row["validation"]) > 0 for row in logged(tmp_path / "run"))
    assert (tmp_path / "run" / "best.safetensors").exists()
    assert (tmp_path / "run" / "metrics.csv").exists()


def test_and_so_they_are_in_stages_where_a_new_run_forgets_old_previews(takes, tmp_path):
    sizes = {key: value for key, value in TINY.items() if key in ("d_model", "ff_dim")}
    sizes = "\n".join(f"{key} = {value}" for key, value in sizes.items())
    steps = "[train]\nsteps = 2\nevaluate_every = 1\n"
    path, old = tmp_path / "c.toml", tmp_path / "run" / "previews" / "step_000001.png"
    path.write_text(f'{HELD_OUT}[model]\nclass = "FACT"\n{sizes}\n{steps}')
    train_from_config(path, tmp_path / "run", takes=takes)
    assert all(float(row["validation"]) > 0 for row in logged(tmp_path / "run" / "train"))
    old.parent.mkdir()
    old.touch()
    train_from_config(path, tmp_path / "run", takes=takes, resume=True)
    assert old.exists()
    train_from_config(path, tmp_path / "run", takes=takes, overwrite=True)
    assert not old.exists()


def test_packaged_config_is_valid():
    config = read_config(CONFIGS / "tcdiffpp_small.toml")
    names = config["model"].pop("extensions")
    packaged = json.loads((hub.ASSETS / "models" / "tcdiffpp" / "config.json").read_text())
    assert names == packaged["extensions"]  # the packaged model is made with it
    assert config["model"].pop("genres") == packaged["genres"]
    assert TCDiffPPConfig(**config["model"]).max_dancers == 5 and config["train"]["steps"] > 0


def test_training_can_set_out_from_a_model(takes, tmp_path):
    """What fits is taken over, its units too; what the model lacks begins anew."""
    path = tmp_path / "c.toml"
    sizes = "\n".join(f"{key} = {value}" for key, value in TINY.items())
    path.write_text(
        f'[model]\n{sizes}\nextensions = ["beat_phase", "preconditioning"]\n'
        "[train]\nsteps = 1\nlr = 1e-12\nema = 0.0\nweight_decay = 0.0\n"
        "[data]\ndancers_per_batch = 4\n"
    )
    start, _ = fresh(takes)
    start.normalizer.low += 0.25
    extended = build(TCDiffPP, read_sizes(path), ["beat_phase", "preconditioning"])
    left_new = take_over(extended, start)
    trained = train_from_config(path, tmp_path / "out", takes=takes, start=start).state_dict()
    assert left_new and all(name.startswith("parts.") for name in left_new), left_new
    fit_statistics(extended, takes, start=start)  # fitted in the units of the start
    mean = "parts.preconditioning.preconditioning.mean"
    torch.testing.assert_close(trained[mean], extended.state_dict()[mean], atol=1e-5, rtol=0)
    for name, value in start.state_dict().items():
        torch.testing.assert_close(trained[name], value, atol=1e-6, rtol=0, msg=name)


def test_a_start_that_has_nothing_in_common_is_refused(takes):
    model, _ = fresh(takes)
    with pytest.raises(ValueError, match="start, a Conv1d, has no weight"):
        take_over(model, torch.nn.Conv1d(1, 1, 1))


def read_sizes(path):
    sizes = read_config(path)["model"]
    del sizes["extensions"]
    return TCDiffPPConfig(**sizes)


def test_the_spectrum_is_that_of_what_the_formation_prior_leaves():
    """Dancers who stand in their places leave nothing on the floor."""
    x = torch.rand(2, 60, 151, generator=torch.Generator().manual_seed(0))
    x[:, :, [4, 6]] = torch.tensor([[-1.0, 0.0], [1.0, 0.0]])[:, None]
    take = DanceTake("row", x, M=torch.rand(60, 35))
    sizes = TCDiffPPConfig(**TINY | {"num_frames": 20})
    spread = {}
    for prior in ((), ("formation_prior",)):
        model = build(TCDiffPP, sizes, ["preconditioning", *prior])
        fit_statistics(model, [take])
        spread[prior] = preconditioning_of(model).std[0, 4].item() / 20**0.5
    assert spread[()] > 0.5 and spread[("formation_prior",)] < 0.01


def test_only_weights_of_the_same_shape_are_taken_over():
    small = torch.nn.Sequential(torch.nn.Linear(2, 3), torch.nn.Linear(3, 1))
    large = torch.nn.Sequential(torch.nn.Linear(2, 3), torch.nn.Linear(3, 2))
    assert take_over(large, small) == ["1.weight", "1.bias"]
    assert torch.equal(large[0].weight, small[0].weight)


def test_genres_are_taken_over_by_name():
    """By number one's own first genre began as the packaged hip-hop; of another count all anew."""
    sizes, names = TCDiffPPConfig(**TINY), (("hiphop", "salsa"), ("tango", "hiphop", "waltz"))
    start, model = (build(TCDiffPP, sizes, ["genre_condition"], genres) for genres in names)
    before = model.parts["genre_condition"].table.clone()
    assert take_over(model, start) == []
    after, known = (one.parts["genre_condition"].table for one in (model, start))
    assert torch.equal(after, torch.stack([before[0], known[0], before[2]]))


def test_a_start_that_hardly_fits_is_told():
    small = torch.nn.Sequential(torch.nn.Linear(2, 3), torch.nn.Linear(3, 1))
    large = torch.nn.Sequential(torch.nn.Linear(2, 3), torch.nn.Linear(3, 20))
    with pytest.warns(UserWarning, match=r"only 10\.1% of the model's weights.*1\.weight"):
        take_over(large, small)


def test_windows_are_drawn_as_the_table_says(takes):
    """A table's ``swaps`` was passed over in autoregressive trainings."""
    corpus = GroupData(swaps=0.5, real=0.25, dancers_per_batch=7, mirror=0.5)
    for model in (TCDiffPP(TCDiffPPConfig(**TINY)), CoDancers(CoDancersConfig())):
        windows = windows_of(takes, corpus, model, seed=3)
        assert (windows.swaps, windows.real, windows.augment.mirror) == (0.5, 0.25, 0.5)
