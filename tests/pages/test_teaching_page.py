"""The teacher's table says of every lesson what the lesson says itself."""

import json
import re
import sys

import pytest

from places import BOOKS, ROOT

sys.path.insert(0, str(BOOKS))

import refresh

PAGE = (ROOT / "docs" / "teaching.md").read_text(encoding="utf-8")
LESSONS = sorted((ROOT / "notebooks").glob("[0-9]*.ipynb"))


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_exercises_and_minutes(path):
    book = json.loads(path.read_text(encoding="utf-8"))
    prose = "\n".join("".join(c["source"]) for c in book["cells"])
    minutes = [int(m) for m in re.findall(r"🧩 Exercise [\d.]+ — .*· (\d+) min", prose)]
    title = re.match(r"# (\d\d) · ([^:\n]+)", prose).groups()
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| {title[0]} {title[1]}"))
    assert row.split("|")[-3:-1] == [f" {len(minutes)} ", f" {sum(minutes)} "]


def test_all_are_counted():
    from dancediff.exercises import EXERCISES

    assert f"{len(LESSONS)} lessons".replace("17", "Seventeen") in PAGE
    assert f" {len(EXERCISES)} exercises" in PAGE
    assert len(EXERCISES) >= 35


def test_a_lesson_takes_as_long_as_its_first_line_says():
    table = json.loads((ROOT / "docs" / "results" / "lessons.json").read_text(encoding="utf-8"))
    seconds = dict(table["rows"])
    assert len(seconds) == len(LESSONS)
    for path in LESSONS:
        head = "".join(json.loads(path.read_text(encoding="utf-8"))["cells"][0]["source"])
        said = re.search(r"⏱ ([^—]+) —", head)[1]
        assert said == refresh.badge(seconds[path.name[:2]]), "run: python notebooks/refresh.py"
