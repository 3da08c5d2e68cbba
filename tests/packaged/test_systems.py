"""The packaged systems of both papers' tables: small, loaded by name, danced and measured alike."""

import re
import sys

import pytest
import torch

import dancediff as dd
from dancediff import hub
from dancediff.cli import main
from places import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))

from package_systems import SYSTEMS

ALONE = ("edge", "fact", "mnet", "bailando")  # each dancer by itself


def test_all_of_them_come_with_the_package_and_are_small():
    assert set(SYSTEMS) <= set(dd.packaged_models())
    folders = [hub.model_folder(name) for name in SYSTEMS]
    size = sum(path.stat().st_size for folder in folders for path in folder.iterdir())
    assert size < 15e6, f"{size / 1e6:.1f} MB"


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_system_dances_longer_than_its_window(name):
    model, song = dd.load(name), dd.packaged_song()
    dance = model.generate(song, dancers=2, seconds=7, seed=3)
    assert (dance.num_dancers, dance.num_frames) == (2, 210)
    again = model.generate(song, dancers=2, seconds=7, seed=3)
    other = model.generate(song, dancers=2, seconds=7, seed=4)
    assert torch.equal(dance.pose, again.pose) and torch.equal(dance.root, again.root)
    assert not torch.allclose(dance.pose, other.pose, atol=1e-3)
    height = dance.joints()[..., 1].amax(-1)  # of the highest joint, (n f)
    assert height.min() > 0.5 and height.max() < 2.6  # nobody lies down or flies


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_card_names_its_training_and_its_scores(name):
    card = (hub.model_folder(name) / "card.md").read_text(encoding="utf-8")
    assert card.startswith(f"# {name}\n") and f"bench-models {name}_tiny --minutes" in card
    assert re.search(r"FID_k [\d.e+]+ \[", card) and "docs/results/tables.md" in card


@pytest.mark.parametrize("name", ALONE)
def test_a_solo_system_dances_groups_dancer_by_dancer(name):
    model, song = dd.load(name), dd.packaged_song()
    trio = model.generate(song, dancers=3, seconds=5, seed=0)
    duet = model.generate(song, dancers=2, seconds=5, seed=0)
    assert torch.allclose(trio.pose[:2], duet.pose, atol=1e-4)


def test_the_command_dances_and_measures_a_system(tmp_path, capsys):
    words = ["generate", "packaged", "--model", "edge", "--dancers", "2", "--seconds", "5"]
    assert main([*words, "--formats", "npz", "--out", str(tmp_path)]) == 0
    (dance,) = tmp_path.glob("*.npz")
    assert main(["evaluate", str(dance), "--song", "packaged"]) == 0
    assert "MMC" in capsys.readouterr().out


def test_five_lines_compare_two_systems(capsys):
    text = (ROOT / "docs" / "comparing.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    lines = [line for line in block.splitlines() if line]
    assert len(lines) == 5
    exec(compile(block, "comparing.md", "exec"), {})
    said = capsys.readouterr().out
    assert said.count("MMC") == 2 and "edge" in said and "tcdiffpp" in said
