"""Ablations of Lodge: `dancediff.training.ablation_data` and the Lodge side of its config."""

import json

import pytest
import torch

from dancediff.motion.motion import Motion
from dancediff.papers.lodge.global_diffusion import GlobalConfig
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.papers.lodge.model import LodgeConfig
from dancediff.training.ablation import run_ablation
from dancediff.training.ablation_config import read_ablation
from dancediff.training.ablation_data import held_out_dances, held_out_genres, held_out_songs
from places import CONFIGS

BASE = """
[data]
songs = 2
seconds = 9.0
windows_per_batch = 2
[model]
class = "Lodge"
extensions = ["preconditioning"]
[global_stage]
d_model = 16
num_heads = 2
num_layers = 1
ff_dim = 32
dropout = 0.0
music_frames = 128
local_frames = 64
[local_stage]
d_model = 16
num_heads = 2
num_layers = 1
ff_dim = 32
dropout = 0.0
num_frames = 64
genres = ["hiphop", "popping", "locking", "house", "waacking", "jazz", "salsa", "contemporary",
          "bollywood", "kpop"]
[train]
steps = 2
warmup = 0
[held_out]
songs = 2
seconds = 6.0
dancers = 1
reference = 2
[sample]
steps = 2
"""


@pytest.fixture
def config(tmp_path):
    def write(variants, base=BASE):
        path = tmp_path / "a.toml"
        path.write_text(base + variants)
        return path

    return write


def judge(dances, *, reference, songs):
    assert len(dances) == len(songs) == 2 and reference
    assert {(dance.num_dancers, dance.num_frames) for dance in [*dances, *reference]} == {(1, 180)}
    x = torch.stack([dance.root.mean() for dance in dances])
    return {"x": {"value": x.mean().item(), "low": None, "high": None}}


@pytest.mark.slow
def test_switches_of_training_and_of_sampling(config, tmp_path):
    """Sampling alone shares a training; each switch changes the dance; genres are the songs'."""
    out = tmp_path / "out"
    path = config(
        "[variants.full]\n[variants.no-C]\nsample = { soft = 0.0 }\n"
        "[variants.no-FR]\nlocal_stage = { foot_refine = false }\n"
    )
    rows = {row["variant"]: row for row in run_ablation(path, out, evaluate=judge)}
    assert list(rows) == ["choreographer", "full", "no-C", "no-FR"]
    assert rows["full"]["training"] == rows["no-C"]["training"] != rows["no-FR"]["training"]
    assert len({row["scores"]["x"]["value"] for row in rows.values()}) == 4
    first = Motion.load(next((out / "variants" / "full").glob("*/dance_0.npz")))
    assert first.meta["genre"] == held_out_genres(read_ablation(path)[0])[0]
    assert json.loads((out / "results.json").read_text())


def test_songs_and_dances_belong_together(config):
    variant = read_ablation(config("[variants.full]\n"))[0]
    dances, songs = held_out_dances(variant), held_out_songs(variant)
    for dance, song in zip(dances, songs, strict=True):
        assert abs(len(song.features()) - dance.num_frames) <= 1
    assert [d.num_dancers for d in dances] == [1, 1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[variants.full]\ndata = { songs = 3 }\n", "'full' changes 'data'"),
        ("[variants.full]\nlocal_stage = { feet = 1 }\n", "'local_stage' has no 'feet'"),
        ("[variants.full]\ntrain_local = { lr = -1.0 }\n", "'train_local': lr=-1.0"),
        ("[variants.full]\nsample = { softness = 1 }\n", "'sample': softness=1 is no option"),
    ],
)
def test_mistakes_are_named(config, text, message):
    with pytest.raises(ValueError, match=message):
        read_ablation(config(text))


def test_more_dancers_than_one_are_refused(config):
    with pytest.raises(ValueError, match=r"dancers=3 must be 1: Lodge is trained on solos"):
        read_ablation(config("[variants.full]\n", BASE.replace("dancers = 1", "dancers = 3")))


def test_config_has_every_switch_of_tables_3_to_7():
    variants = {v.name: v for v in read_ablation(CONFIGS / "ablate_lodge.toml")}
    sizes = {
        name: LodgeConfig(
            GlobalConfig(**v.tables["global_stage"]), LocalConfig(**v.tables["local_stage"])
        )
        for name, v in variants.items()
    }
    assert len({v.training for v in variants.values()}) == 8
    assert sorted({v.sample.soft for v in variants.values()}) == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert not variants["no-M"].sample.mirror and not variants["no-B"].sample.beat_align
    assert not sizes["no-FR"].local_stage.foot_refine
    assert sizes["discrete"].global_stage.variant == "discrete"
    lengths = {(s.global_stage.music_frames, s.num_frames) for s in sizes.values()}
    assert lengths == {(1024, 256), (1024, 512), (1024, 128), (512, 256), (512, 128)}
