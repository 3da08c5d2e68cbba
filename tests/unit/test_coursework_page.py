"""What docs/coursework.md shows runs."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "coursework.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("code", BLOCKS, ids=range(len(BLOCKS)))
def test_block_runs(code, capsys):
    exec(code, {})
    assert "False" not in capsys.readouterr().out


def test_there_are_blocks():
    assert len(BLOCKS) >= 4
