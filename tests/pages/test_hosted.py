"""Binder and Colab are told only what is there; a syllabus keeps the order of lessons."""

import os
import re
import subprocess
import tomllib

import pytest

from places import ROOT

BINDER = ROOT / ".binder"
PAGE = (ROOT / "docs" / "teaching.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_binder_reads_all_files_and_no_others():
    names = {path.name for path in BINDER.iterdir()}
    assert names == {"requirements.txt", "runtime.txt", "postBuild"}


def test_binder_installs_from_the_project_and_the_index_of_pytorch():
    lines = (BINDER / "requirements.txt").read_text(encoding="utf-8").splitlines()
    told = [line for line in lines if not line.startswith("#")]
    index = "--extra-index-url https://download.pytorch.org/whl/cpu"
    assert told == [index, "-r ../requirements.txt"]
    assert (BINDER / "../requirements.txt").is_file()
    assert index.split()[1] in (ROOT / "environment.yml").read_text(encoding="utf-8")


def test_binder_has_a_python_that_the_project_allows():
    said = (BINDER / "runtime.txt").read_text(encoding="utf-8").strip()
    least = PROJECT["requires-python"].removeprefix(">=").split(".")
    assert list(map(int, said.removeprefix("python-").split("."))) >= list(map(int, least))


def test_binder_runs_a_command_that_exists():
    script = BINDER / "postBuild"
    if os.name != "nt":  # there no file is executable without a suffix that says so
        assert script.stat().st_mode & 0o111, "it must be executable"
        assert subprocess.run(["bash", "-n", script], check=False).returncode == 0
    from dancediff.cli.commands import COMMANDS

    words = [line.split() for line in script.read_text(encoding="utf-8").splitlines()]
    commands = [line[1] for line in words if line[:1] == ["dancediff"]]
    assert commands == ["warm"] and "warm" in COMMANDS


def test_colab_is_told_an_extra_and_a_folder_that_exist():
    (cell,) = re.findall(r"^```text\n(!git clone.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    (extra,) = re.findall(r"\./dancediff\[(\w+)\]", cell)
    (folder,) = re.findall(r"^%cd dancediff/(\S+)", cell, re.MULTILINE)
    assert extra in PROJECT["optional-dependencies"] and (ROOT / folder / "student.py").exists()
    assert "http" not in cell, "the address is the teacher's"


def numbers(text: str) -> list[str]:
    """Lessons of a cell.

    >>> numbers("05 to 07, 13"), numbers("-")
    (['05', '06', '07', '13'], [])
    """
    found = []
    for first, last in re.findall(r"(\d\d)(?: to (\d\d))?", text):
        found += [f"{k:02d}" for k in range(int(first), int(last or first) + 1)]
    return found


def table_rows(first: str) -> list[list[str]]:
    """Cells of the table whose head begins so."""
    _, _, rest = PAGE.partition(f"| {first} |")
    lines = rest.split("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


NEEDS = {row[0][:2]: numbers(row[2]) for row in table_rows("lesson")}


@pytest.mark.parametrize(("column", "weeks"), [(1, 6), (3, 12)])
def test_a_syllabus_teaches_first_what_a_lesson_needs(column, weeks):
    told: set[str] = set()
    plan = [row for row in table_rows("week") if row[column]]
    assert len(plan) == weeks
    for row in plan:
        lessons = numbers(row[column])
        for lesson in lessons:
            assert set(NEEDS[lesson]) <= told, lesson
            told.add(lesson)
        task = re.match(r"(\d\d)\.\d", row[column + 1])
        assert task is None or task[1] in lessons
    assert weeks == 6 or told == set(NEEDS), "twelve weeks teach all lessons"
