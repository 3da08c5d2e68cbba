"""Values of a TOML config: what is of another kind is named, before anything is done."""

import pytest

from dancediff.training.lodge import check_lodge_tables
from dancediff.training.run import check_tables
from dancediff.training.tables import read_training


@pytest.mark.parametrize(
    "config, words",
    [
        ({"train": {"steps": "many"}}, "'train': steps='many' should be a whole number"),
        ({"train": {"steps": True}}, "steps=True should be a whole number"),
        ({"train": {"lr": "1e-3"}}, "lr='1e-3' should be a number"),
        ({"train": {"weights": {}}}, "'train' has no 'weights'"),
        ({"model": {"dropout": "no"}}, "'model': dropout='no' should be a number"),
        ({"model": {"without": ["lstm"]}}, "'model': without: 'lstm' is not one of dancer"),
        ({"model": {"extensions": ["wings"]}}, "'model': extensions: 'wings' is not one of those"),
        ({"model": {"extensions": ["foot_cues"]}}, "'foot_cues' needs 'preconditioning'"),
        ({"model": {"extensions": "ssd"}}, "'model': extensions='ssd' should be a list"),
        ({"model": {"class": "EDGE", "extensions": ["ssd"]}}, "'ssd' is not one of those of EDGE"),
        ({"model": {"class": ["EDGE"]}}, "class \\['EDGE'\\] is not one of"),
        ({"extensions": {"masked_music": "mfcc"}}, "masked_music='mfcc' should be a list"),
        ({"extensions": {"masked_music": ["bass"]}}, "masked_music: 'bass' is not one of"),
        ({"extensions": {"level_weights": 1.5}}, "'extensions': level_weights=1.5 must lie"),
        ({"extensions": {"slide_loss": -1}}, "'extensions': slide_loss=-1 must be 0 or more"),
        ({"extensions": {"level_weights": 0.5}}, "level_weights=0.5 needs 'preconditioning' in"),
        (
            {"model": {"class": "EDGE"}, "extensions": {"own_overlap": 0.25}},
            "'extensions': own_overlap=0.25 is for tcdiffpp, not for edge; leave it out",
        ),
        ({"data": {"dancers_per_batch": 0}}, "'data': dancers_per_batch=0 must be 1 or more"),
        ({"data": {"dancers_per_batch": -4}}, "dancers_per_batch=-4 must be 0 or more"),
        ({"data": {"seconds": 1}}, "seconds=1 must be 3 or more"),
        ({"data": {"songs": 0}}, "songs=0 must be 1 or more"),
        ({"data": {"real": 1.5}}, "'data': real=1.5 must lie in 0 ... 1"),
        ({"train": {"warmup": -1}}, "'train': warmup=-1 must be 0 or more"),
        ({"train": {"preview_every": -1}}, "preview_every=-1 must be 0 or more"),
        ({"train": {"lr": float("nan")}}, "lr=nan must be 0 or more"),
        ({"train": {"seed": 10**30}}, "'train': seed=1000000000000000000000000000000 must lie in"),
        ({"weights": {"vel": -0.1}}, "'weights': vel=-0.1 must be 0 or more"),
        ({"model": {"num_layers": 10**9}}, "'model': num_layers=1000000000 must lie in 1 ... 64"),
        ({"model": {"d_model": 0}}, "'model': d_model=0 must lie in 1 ... 8192"),
        ({"model": {"num_frames": 1}}, "'model': num_frames=1 must lie in 2 ..."),
        ({"model": {"class": "EDGE", "ff_dim": -8}}, "'model': ff_dim=-8 must lie in 1 ..."),
        ({"data": 5}, "'data' is 5, no table"),
        ({"weights": {"dist": "high"}}, "'weights': dist='high' should be a number"),
    ],
)
def test_values_of_another_kind_are_named(config, words):
    with pytest.raises(ValueError, match=words):
        check_tables(config, "a.toml")


def test_of_lodge_too():
    with pytest.raises(ValueError, match=r"'train_local': steps=1\.5 should be a whole number"):
        check_lodge_tables({"train_local": {"steps": 1.5}}, "a.toml")
    for bad, words in (
        ({"local_stage": {"num_layers": 65}}, "'local_stage': num_layers=65 must lie in 1 ... 64"),
        ({"data": {"windows_per_batch": 0}}, "'data': windows_per_batch=0 must be 1 or more"),
        ({"weights_local": {"slide": 0.1}}, "has no 'slide'; known: class, contact"),
        ({"train_global": {"steps": -1}}, "'train_global': steps=-1 must be 0 or more"),
        ({"model": {"d_model": 8}}, "'model' has no 'd_model'"),
        ({"extensions": {"own_overlap": 0.25}}, "own_overlap=0.25 is for tcdiffpp, not for lodge"),
        ({"extensions": {"level_weights": 0.5}}, "level_weights=0.5 needs 'preconditioning' in"),
    ):
        with pytest.raises(ValueError, match=words):
            check_lodge_tables(bad, "a.toml")
    tables = check_lodge_tables({"local_stage": {"genres": ["salsa"]}}, "a.toml")
    assert tables["local_stage"] == {"genres": ("salsa",)}


def test_training_extensions_that_are_off_may_stand_anywhere():
    """A variant of an ablation takes back what its class cannot have."""
    off = {"own_overlap": 0.0, "level_weights": 0, "both_guesses": False, "own_loss_weight": 2.0}
    check_tables({"model": {"class": "EDGE"}, "extensions": off}, "a.toml")
    check_lodge_tables({"extensions": off}, "a.toml")


def test_whole_numbers_are_numbers_and_lists_become_tuples():
    tables = check_tables({"train": {"lr": 1, "decay": 0}, "model": {"class": "EDGE"}}, "")
    assert tables["train"] == {"lr": 1, "decay": 0}
    assert tables["data"] == {}


def test_a_config_may_begin_with_the_mark_of_an_editor_on_windows(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text("[model]\n[train]\nsteps = 5\n", encoding="utf-8-sig")
    assert read_training(path) == {"model": {}, "train": {"steps": 5}}
