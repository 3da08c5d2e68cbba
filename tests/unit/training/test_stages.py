"""Settings of trainings in stages: what only fits together across tables, and what is replaced."""

import pytest

from dancediff.training.autoregressive import check_autoregressive_tables
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
