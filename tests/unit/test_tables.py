"""Values of a TOML config: what is of another kind is named, before anything is done."""

import pytest

from dancediff.training.lodge import check_lodge_tables
from dancediff.training.run import check_tables


@pytest.mark.parametrize(
    "config, words",
    [
        ({"train": {"steps": "many"}}, "'train': steps='many' should be a whole number"),
        ({"train": {"steps": True}}, "steps=True should be a whole number"),
        ({"train": {"lr": "1e-3"}}, "lr='1e-3' should be a number"),
        ({"train": {"weights": {}}}, "'train' has no 'weights'"),
        ({"model": {"fp": 1}}, "'model': fp=1 should be true or false"),
        ({"model": {"ssm": 2}}, "ssm=2 should be a text"),
        ({"model": {"class": ["EDGE"]}}, "class \\['EDGE'\\] is not one of"),
        ({"data": {"unheard": "mfcc"}}, "unheard='mfcc' should be a list"),
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
    tables = check_lodge_tables({"local_stage": {"genres": ["salsa"]}}, "a.toml")
    assert tables["local_stage"] == {"genres": ("salsa",)}


def test_whole_numbers_are_numbers_and_lists_become_tuples():
    tables = check_tables({"train": {"lr": 1, "max_minutes": 5}, "model": {"class": "EDGE"}}, "")
    assert tables["train"] == {"lr": 1, "max_minutes": 5}
    assert tables["data"] == {}
