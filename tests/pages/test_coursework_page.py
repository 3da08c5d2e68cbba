"""What docs/coursework.md shows runs, typed as a student would."""

import json
import re
import shlex
import sys

import pytest

import dancediff as dd
from dancediff.cli import main
from places import DOCS

PAGE = DOCS / "coursework.md"
TEXT = PAGE.read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
FILES = re.findall(r"```\w+\n# (\w+\.\w+)\n(.*?)```", TEXT, re.DOTALL)
COMMANDS = "".join(re.findall(r"```sh\n(.*?)```", TEXT, re.DOTALL)).replace("\\\n", "").splitlines()


@pytest.mark.parametrize("code", BLOCKS, ids=range(len(BLOCKS)))
def test_block_runs(code, capsys):
    exec(code, {})
    assert "False" not in capsys.readouterr().out


def test_there_are_blocks():
    assert len(BLOCKS) >= 8 and len(COMMANDS) == 4
    for name, code in FILES:
        if name.endswith(".py"):
            lines = [line for line in code.splitlines() if line.strip()]
            assert len(lines) < 15, name


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A folder with the page's files, in which a student works."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    modules = {name.removesuffix(".py") for name, _ in FILES}
    for name in modules:
        monkeypatch.delitem(sys.modules, name, raising=False)
    for name, code in FILES:
        (tmp_path / name).write_text(code)
    yield tmp_path
    for name in modules:
        sys.modules.pop(name, None)


@pytest.mark.slow
def test_the_commands_train_compare_save_load_dance_and_measure(desk, capsys):
    for line in COMMANDS:
        program, *words = shlex.split(line)
        assert program == "dancediff" and main(words) == 0, capsys.readouterr().err
    told = capsys.readouterr().out
    assert "metric:width" in told
    rows = {row["variant"]: row for row in json.loads((desk / "runs/own/results.json").read_text())}
    assert set(rows) == {"choreographer", "paper", "mean", "scan", "calm"}
    for name, row in rows.items():
        assert "failed" not in row and row["scores"]["metric:width"]["value"] > 0, name
    assert "own_loss" in (desk / "runs" / "mean" / "losses.csv").read_text()
    dance = dd.Motion.load(desk / "out" / "dance.npz")
    assert dance.meta["sampler"] == "sampler:straight"

    folder = desk / "runs" / "mean" / "model"
    assert json.loads((folder / "config.json").read_text())["class"] == "fusion:MeanFusion"
    with pytest.raises(ValueError, match=r"not run unasked; .*own='fusion:MeanFusion'"):
        dd.load(folder)
    again = dd.load(folder, own=sys.modules["fusion"].MeanFusion)
    assert type(again.model.decoder.fusion_projection).__name__ == "Mean"
    with pytest.raises(ValueError, match=r"MeanSoFar has a part that was not there in training"):
        dd.load(folder, own="scan:MeanSoFar")
