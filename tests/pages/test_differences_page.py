"""docs/differences.md: every decision has its line, and every line has its test."""

import re

import pytest

from places import ROOT

PAGE = (ROOT / "docs" / "differences.md").read_text(encoding="utf-8")
TABLES = {  # mark of the lines -> how many there are at least
    "": 29,
    "L": 26,
}


def rows(mark):
    """Cells of the lines whose number starts with ``mark``."""
    lines = [line for line in PAGE.splitlines() if re.match(rf"\| {mark}\d+ \|", line)]
    return [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines]


@pytest.mark.parametrize("mark", TABLES)
def test_lines_are_numbered_and_whole(mark):
    found = rows(mark)
    assert [row[0] for row in found] == [f"{mark}{k}" for k in range(1, len(found) + 1)]
    assert len(found) >= TABLES[mark]
    assert all(len(row) == 6 and all(row) for row in found)
    topics = [row[1] for row in found]
    assert len(set(topics)) == len(topics)


def test_every_line_names_a_test_that_exists():
    files = {path.name: path for path in (ROOT / "tests").rglob("test_*.py")}
    found = [row for mark in TABLES for row in rows(mark)]
    named = [re.fullmatch(r"`(test_\w+\.py)::(test_\w+)`", row[-1]) for row in found]
    assert all(named)
    for match in named:
        text = files[match[1]].read_text(encoding="utf-8")
        assert re.search(rf"^def {match[2]}\(", text, re.MULTILINE), match[0]
    assert len({match[0] for match in named}) == len(found)  # one each


def test_numbers_in_the_table_of_weights_are_those_of_the_models():
    import torch

    from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

    columns = {2: 2, 5: 3}
    table = PAGE.split("## Number of weights")[1]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines() if line.count(" | ") == 3]
    parts = [row for row in rows if row[-1].replace(",", "").strip("| ").isdigit()]
    for C, column in columns.items():
        numbers = [int(row[column].strip("| ").replace(",", "")) for row in parts]
        with torch.device("meta"):
            model = TCDiffPP(TCDiffPPConfig.paper(max_dancers=C))
        total = sum(p.numel() for p in model.parameters())
        assert numbers[-1] == sum(numbers[:-1]) == total
