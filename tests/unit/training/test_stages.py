"""Settings of trainings in stages: what only fits together across tables, and what is replaced."""

import pytest
import torch

from dancediff.data.choreographed import choreographed_takes
from dancediff.training.autoregressive import (
    StageObjective,
    check_autoregressive_tables,
    train_autoregressive,
)
from dancediff.training.lodge import STAGES, check_lodge_tables, stage_config
from dancediff.training.stages import StageConfig, stage_settings

UNITS = {"model": {"class": "CoDancers"}}


def test_patience_may_stand_in_another_table_than_evaluate_every():
    tables = {"train": {"evaluate_every": 100}, "train_local": {"patience": 3}}
    local = stage_config(check_lodge_tables(tables, "a.toml"), "local")
    assert (local.evaluate_every, local.patience) == (100, 3)
    tables = UNITS | {"train": {"patience": 3}}
    tables |= {f"train_{stage}": {"evaluate_every": 100} for stage in ("units", "gpt")}
    gpt = stage_settings(check_autoregressive_tables(tables, "a.toml"), "gpt")
    assert (gpt.evaluate_every, gpt.patience) == (100, 3)


def test_patience_without_evaluations_is_named_with_its_stage():
    tables = {"train": {"patience": 3}, "train_global": {"evaluate_every": 5}}
    with pytest.raises(ValueError, match=r"a\.toml: 'train_local': patience=3 counts evaluations"):
        check_lodge_tables(tables, "a.toml")
    left_out = {f"train_{stage}": {"steps": 0} for stage in STAGES if stage != "global"}
    check_lodge_tables(tables | left_out, "a.toml")  # what is not trained needs nothing
    with pytest.raises(ValueError, match=r"'train_gpt': patience=3 counts evaluations"):
        check_autoregressive_tables(UNITS | {"train_gpt": {"patience": 3}}, "a.toml")


@pytest.mark.parametrize("wrong", [{"patience": -1}, {"evaluate_every": -1}, {"warmup": -1}])
def test_a_table_alone_is_still_checked(wrong):
    ((name, value),) = wrong.items()
    with pytest.raises(ValueError, match=f"{name}={value} must be 0 or more"):
        StageConfig(**wrong)


TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
TINY |= {"width": 16, "code_dim": 8, "num_codes": 16, "length": 7}
TRAIN = {"steps": 2, "warmup": 0, "decay": 0.0, "save_every": 1}


@pytest.fixture(scope="module")
def takes():
    return choreographed_takes(0, seconds=6.0, sizes=(2,))


def codancers(folder, takes, *, seed=0, units=2, gpt=2, **run):
    tables = {"model": TINY | {"class": "CoDancers"}, "train": TRAIN | {"seed": seed}}
    tables |= {"train_units": {"steps": units}, "train_gpt": {"steps": gpt}}
    return train_autoregressive(tables, folder, takes=takes, **run).state_dict()


def same(a, b):
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)


def test_what_a_stage_learns_after_all_is_not_thrown_away(takes, tmp_path):
    """A run goes on with more steps of its first stage; the second was taken as done."""
    whole = codancers(tmp_path / "whole", takes, units=3)
    first = codancers(tmp_path / "parts", takes)
    with pytest.warns(UserWarning, match=r"what is in \S+gpt is trained anew"):
        parts = codancers(tmp_path / "parts", takes, units=3, resume=True)
    assert same(parts, whole) and not same(parts, first)
    assert same(codancers(tmp_path / "parts", takes, units=3, resume=True), whole)


def test_a_stage_that_is_left_out_stays_in_its_folder(takes, tmp_path, capsys):
    first = codancers(tmp_path, takes)
    bars = capsys.readouterr().err
    assert "training units: " in bars and "training gpt: " in bars, "they all said training"
    kept = codancers(tmp_path, takes, units=3, gpt=0, resume=True)
    assert same(kept, first)


def test_an_overwritten_training_that_was_stopped_goes_on_as_the_new_one(takes, tmp_path):
    """Stopped in its first stage, it went on with the old second one."""
    whole = codancers(tmp_path / "whole", takes, seed=1)
    codancers(tmp_path / "parts", takes)

    def stop(self, model, batch, number):
        if number == 1:
            raise KeyboardInterrupt
        return losses(self, model, batch, number)

    losses = StageObjective.losses
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(StageObjective, "losses", stop)
        with pytest.raises(KeyboardInterrupt):
            codancers(tmp_path / "parts", takes, seed=1, overwrite=True)
    assert same(codancers(tmp_path / "parts", takes, seed=1, resume=True), whole)


def test_a_validation_without_any_of_the_genres_is_said(takes, tmp_path):
    """Of the other takes only; it was empty, and no word of it."""
    sizes = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "critic_hidden": 8}
    tables = {"model": sizes | {"class": "MNET", "genres": [takes[0].genre]}}
    tables |= {"data": {"songs": 1, "held_out": 1, "seconds": 6.0, "varied": False, "workers": 1}}
    tables |= {"train": TRAIN | {"steps": 1, "evaluate_every": 1}}
    with pytest.warns(UserWarning, match=rf"there is no validation: .* genres {takes[0].genre}"):
        train_autoregressive(tables, tmp_path, takes=takes)
