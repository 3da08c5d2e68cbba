"""What docs/coursework.md shows runs."""

import re

import pytest

from places import DOCS

PAGE = DOCS / "coursework.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("code", BLOCKS, ids=range(len(BLOCKS)))
def test_block_runs(code, capsys):
    exec(code, {})
    assert "False" not in capsys.readouterr().out


def test_there_are_blocks():
    assert len(BLOCKS) >= 4
