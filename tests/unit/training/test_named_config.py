"""Configs have names: a user without a checkout trains, too."""

import pytest

from dancediff.cli import main
from dancediff.training.named_config import config_file, packaged_configs
from places import CONFIGS


def test_every_config_has_a_name():
    assert packaged_configs() == {path.stem: path for path in CONFIGS.glob("*.toml")}


def test_a_file_wins_over_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert config_file("lodge_small") == CONFIGS / "lodge_small.toml"
    (tmp_path / "lodge_small").write_text("")
    assert config_file("lodge_small").resolve() == tmp_path / "lodge_small"


def test_an_unknown_name_is_told_with_the_known_ones(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"'lodge_huge' does not exist; .*lodge_small.* in .*conf"):
        config_file("lodge_huge")


@pytest.mark.parametrize("command, more", [("train", ""), ("ablate", "[variants.full]\n")])
def test_the_commands_take_a_name(command, more, tmp_path, monkeypatch, capsys):
    """A key that no training has shows that the file of this name was read, and nothing more."""
    monkeypatch.setattr("dancediff.training.named_config._PLACES", (tmp_path,))
    (tmp_path / "mine.toml").write_text(f"[model]\n[train]\nwarp = 1\n{more}")
    assert main([command, "mine", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "mine.toml" in said and "warp" in said
