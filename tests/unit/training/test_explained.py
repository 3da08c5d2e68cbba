"""What `dancediff train --explain` says of a config is what the dataclasses say."""

import re
from pathlib import Path

import pytest

from dancediff.cli import main
from dancediff.training import autoregressive, lodge, run
from dancediff.training.explained import defaults_of, explain_config, notes_of
from places import ROOT

SIZES = [sizes for _, sizes in [*run.MODELS.values(), *autoregressive.MODELS.values()]]
GROUPS = {kind for pair in run.MODELS.values() for kind in run.tables_of(*pair).values()}
KINDS = {*SIZES, *GROUPS, *lodge.TABLES.values()} - {lodge.TABLES["model"]}
CONFIGS = sorted((ROOT / "configs").glob("[!a]*.toml"))


@pytest.mark.parametrize("kind", sorted(KINDS, key=lambda kind: kind.__name__))
def test_every_key_has_a_line(kind):
    assert defaults_of(kind).keys() <= notes_of(kind).keys()


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_key_of_a_config_is_explained(path):
    text = explain_config(path)
    assert all(len(line) <= 100 for line in text.splitlines()[1:])
    config = run.read_training(path)
    for table in text.split("\n\n")[1:]:
        name = re.match(r"\[(\w+)\]\n", table)[1]
        starred = re.findall(r"^\* (\w+) =", table, re.MULTILINE)
        assert sorted(starred) == sorted(config.get(name, {}))


def test_values_stand_beside_their_defaults(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text('[model]\nclass = "EDGE"\n[train]\nsteps = 5\nseed = 0\n')
    text = explain_config(path)
    assert "\n* steps = 5 [10000] " in text and "\n* seed = 0    " in text
    assert "\n  lr = 0.001      " in text and "fusion_hidden" not in text
    path.write_text('[model]\nclass = "Lodge"\n[train]\nlr = 1\n[train_local]\nlr = 2\n')
    text = explain_config(path)
    assert "* lr = 2 [1]" in text and "without this table there is none" in text
    assert "joint = 0.636" in text and "joint = 1 " in text  # the stages' own weights


def test_the_command_explains_and_trains_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["train", str(ROOT / "configs/edge_small.toml"), "--explain"]) == 0
    assert "[train]" in capsys.readouterr().out and list(Path().iterdir()) == []
    (tmp_path / "b.toml").write_text("[model]\nd_modle = 5\n[train]\n")
    assert main(["train", "b.toml", "--explain"]) == 2
    assert "'model' has no 'd_modle'" in capsys.readouterr().err
