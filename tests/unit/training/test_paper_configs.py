"""configs/*_paper.toml say what the papers say, train, and their models dance as the papers say.

Trained here are copies with other sizes, fewer steps and smaller batches; every other key stays.
"""

import csv
from pathlib import Path

import pytest

from dancediff import hub
from dancediff.music.synth import synth_song
from dancediff.papers.edge.model import EDGEConfig
from dancediff.papers.lodge.genre_discriminator import DiscriminatorConfig
from dancediff.papers.lodge.global_diffusion import GlobalConfig
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.papers.lodge.losses import LodgeWeights
from dancediff.papers.tcdiffpp.model import TCDiffPPConfig
from dancediff.training.config import TrainingExtensions
from dancediff.training.lodge import check_lodge_tables, stage_config
from dancediff.training.run import read_config, settings_of, train_from_config
from dancediff.training.schedule import learning_rate
from dancediff.training.tables import read_toml
from places import CONFIGS

SMALL = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
QUICK = {"steps": 20, "save_every": 20, "evaluate_every": 10}
PAPER = {"sampler": "ddim", "steps": 50, "eta": 1.0, "guidance": 2.0, "foot_contact": False}
GENRES = ["hiphop", "salsa", "jazz"]


def written(path: Path, tables: dict) -> Path:
    """Tables of plain values as TOML, which writes them as Python does, but for bools."""
    lines = []
    for name, values in tables.items():
        lines.append(f"[{name}]")
        lines += [f"{key} = {str(v).lower() if v is True or v is False else repr(v)}"
                  for key, v in values.items()]  # fmt: skip
    path.write_text("\n".join(lines) + "\n")
    return path


def changed(tables: dict, changes: dict) -> dict:
    """Tables with other values for keys that they have, or sizes that they leave at a default."""
    return tables | {name: tables.get(name, {}) | values for name, values in changes.items()}


def losses(folder: Path) -> list[float]:
    rows = csv.DictReader((folder / "losses.csv").read_text().splitlines())
    return [float(row["total"]) for row in rows]


@pytest.mark.parametrize(
    ("name", "sizes", "optimizer", "lr"),
    [("tcdiffpp", TCDiffPPConfig, "adam", 5e-5), ("edge", EDGEConfig, "adan", 2e-4)],
)
def test_groups(name, sizes, optimizer, lr, tmp_path):
    tables = read_config(CONFIGS / f"{name}_paper.toml")
    kept = {
        key: value for key, value in tables["model"].items() if key not in ("class", "extensions")
    }
    assert sizes(**kept) == sizes.paper()
    settings = settings_of(tables)
    assert settings.extensions == TrainingExtensions()
    assert (settings.optimizer, settings.lr, settings.ema) == (optimizer, lr, 0.9999)
    assert [learning_rate(k, settings) for k in (0, 10_000)] == [lr, lr] and settings.clip == 0
    assert "mirror" not in tables["data"] and "swaps" not in tables["data"]

    small = SMALL | {"num_frames": 30} | ({"fusion_hidden": 32} if name == "tcdiffpp" else {})
    changes = {
        "model": small,
        "train": QUICK,
        "data": {"songs": 2, "seconds": 4.0, "workers": 1, "held_out": 1, "dancers_per_batch": 4},
    }
    quick = changed(read_toml(CONFIGS / f"{name}_paper.toml"), changes)
    model = train_from_config(written(tmp_path / "a.toml", quick), tmp_path / "run")
    total = losses(tmp_path / "run")
    assert len(total) == 20 and sum(total[-5:]) < sum(total[:5])
    assert (tmp_path / "run" / "best.safetensors").exists()
    dances_as_the_paper_says(model, tmp_path, dancers=2, overlap=15)


@pytest.mark.slow
def test_lodge(tmp_path):
    raw = read_toml(CONFIGS / "lodge_paper.toml")
    tables = check_lodge_tables(raw, "lodge_paper")
    assert GlobalConfig(**tables["global_stage"]) == GlobalConfig()
    assert LocalConfig(**tables["local_stage"]) == LocalConfig()
    assert DiscriminatorConfig(**tables["discriminator"]) == DiscriminatorConfig()
    for stage in ("global", "local", "fine_tune"):
        settings = stage_config(tables, stage)
        assert settings.extensions == TrainingExtensions()
        assert (settings.optimizer, settings.lr, settings.clip) == ("adan", 1e-4, 0)
    assert stage_config(tables, "local").weights == LodgeWeights.local()
    assert stage_config(tables, "fine_tune").weights == LodgeWeights.fine_tune()
    assert "mirror" not in tables["data"]

    steps = {key: QUICK[key] for key in ("save_every", "evaluate_every")}
    changes = {
        "global_stage": SMALL | {"music_frames": 128, "local_frames": 64},
        "local_stage": SMALL | {"num_frames": 64, "genres": GENRES},
        "discriminator": SMALL | {"head_hidden": 16},
        "train": steps,
        "data": {"songs": 12, "seconds": 6.0, "held_out": 12}
        | {"windows_per_batch": 2, "global_windows_per_batch": 2},
    }
    changes |= {f"train_{stage}": {"steps": 20} for stage in ("global", "local", "fine_tune")}
    quick = written(tmp_path / "a.toml", changed(raw, changes))
    model = train_from_config(quick, tmp_path / "run")
    for stage in ("global", "local", "fine_tune"):
        total = losses(tmp_path / "run" / stage)
        assert len(total) == 20 and all(value < 1e6 for value in total), stage
    dances_as_the_paper_says(model, tmp_path, genre="salsa")


def dances_as_the_paper_says(model, folder: Path, **options) -> None:
    """The model folder loads, and its model dances with the preset "paper"."""
    hub.save_model(model, folder / "model", card="tiny")
    song, _ = synth_song(3, seconds=4.0)
    dance = hub.load(folder / "model").generate(song, preset="paper", **options)
    assert dance.joints().isfinite().all()
    assert {key: dance.meta[key] for key in PAPER} == PAPER
