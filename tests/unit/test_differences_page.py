"""docs/differences.md: every decision has its line, and every line has its test."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "differences.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("| \n").split(" | ")]
    for line in PAGE.splitlines()
    if re.match(r"\| \d+ \|", line)
]


def test_lines_are_numbered_and_whole():
    assert [int(row[0]) for row in ROWS] == list(range(1, len(ROWS) + 1))
    assert len(ROWS) >= 29
    assert all(len(row) == 6 and all(row) for row in ROWS)
    topics = [row[1] for row in ROWS]
    assert len(set(topics)) == len(topics)


def test_every_line_names_a_test_that_exists():
    files = {path.name: path for path in (ROOT / "tests").rglob("test_*.py")}
    named = [re.fullmatch(r"`(test_\w+\.py)::(test_\w+)`", row[-1]) for row in ROWS]
    assert all(named)
    for match in named:
        text = files[match[1]].read_text(encoding="utf-8")
        assert re.search(rf"^def {match[2]}\(", text, re.MULTILINE), match[0]
    assert len({match[0] for match in named}) == len(ROWS)  # one each


def test_numbers_in_the_table_of_weights_are_those_of_the_models():
    import torch

    from dancediff.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

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
