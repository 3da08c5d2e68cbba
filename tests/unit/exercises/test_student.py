"""What is handed out has no answers in it and runs where it lies; the key has them all."""

import json
import re
import sys

import nbformat
import pytest

from dancediff import grading, nb
from dancediff.exercises.solutions import solution_text
from places import BOOKS

sys.path.insert(0, str(BOOKS))

import student


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    handed_out, key = (tmp_path_factory.mktemp(name) for name in ("course", "key"))
    student.main(handed_out)
    student.main(key, "key")
    return handed_out, key


def lesson_names(folder):
    return sorted(path.name for path in folder.glob("*.ipynb"))


def test_both_have_all_lessons(folders):
    assert all(lesson_names(folder) == lesson_names(BOOKS) for folder in folders)


def test_students_get_no_stored_answer_and_no_solution(folders):
    for path in folders[0].iterdir():
        book = json.loads(path.read_text(encoding="utf-8"))
        code = [cell for cell in book["cells"] if cell["cell_type"] == "code"]
        assert not any(cell["outputs"] or cell["execution_count"] for cell in code)
        sources = ["".join(cell["source"]) for cell in book["cells"]]
        for _, exercise, _ in grading.checks(book):
            assert solution_text(exercise) not in sources, exercise
        assert set(grading.marks(book).values()) == {grading.NOT_RUN}
        for link in re.findall(r"\]\(([^)#]+)\)", "\n".join(sources)):
            assert link.startswith("http") or (folders[0] / link).exists(), link


@pytest.mark.parametrize(
    ("source", "left"),
    [
        ("led off ([how](../docs/a.md)); so", "led off; so"),
        ("is [a residual](../docs/a.md), which", "is a residual, which"),
        ("see ([one](../a.md) or two)", "see (one or two)"),
        ("next ([05](05_b.ipynb))", "next ([05](05_b.ipynb))"),
    ],
)
def test_a_lost_link_leaves_no_words_in_brackets(source, left):
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell(source)])
    assert student.for_students(book).cells[0].source == left


def test_the_lessons_themselves_stay_as_they_are(folders):
    for path in BOOKS.glob("*.ipynb"):
        mine = nbformat.read(folders[0] / path.name, 4)
        its = nbformat.read(path, 4)
        assert [cell.id for cell in mine.cells] == [cell.id for cell in its.cells]
        assert [c.source for c in mine.cells if c.cell_type == "code"] == [
            c.source for c in its.cells if c.cell_type == "code"
        ]


def test_the_key_has_every_exercise_with_its_reason(folders):
    page = (folders[1] / "key.md").read_text(encoding="utf-8")
    assert re.findall(r"^### ([\d.]+) ", page, re.MULTILINE) == list(nb.EXERCISES)
    for exercise in nb.EXERCISES:
        text = solution_text(exercise)
        assert text in page and text.startswith("# ")
    for path in folders[1].glob("*.ipynb"):
        book = nbformat.read(path, 4)
        sources = [cell.source for cell in book.cells]
        assert all(solution_text(exercise) in sources for _, exercise, _ in grading.checks(book))


def test_one_run_sees_every_exercise_open_and_then_solved(tmp_path):
    student.main(tmp_path, "both")
    assert lesson_names(tmp_path) == lesson_names(BOOKS)
    for path in BOOKS.glob("*.ipynb"):
        lesson = nbformat.read(path, 4).cells
        cells = nbformat.read(tmp_path / path.name, 4).cells
        assert [cell for cell in cells if not cell.id.startswith("solved-")] == lesson
        sources = [cell.source for cell in cells]
        for k, exercise, _ in grading.checks({"cells": lesson}):
            solved = sources.index(solution_text(exercise))
            check, again = (j for j, s in enumerate(sources) if s == lesson[k].source)
            assert check < solved < again, exercise
            takers = [j for j, s in enumerate(sources) if f'nb.answer("{exercise}"' in s]
            half = len(takers) // 2
            assert all(check < j < solved for j in takers[:half])
            assert all(again < j for j in takers[half:]) and len(takers) == 2 * half
    assert len(list(tmp_path.iterdir())) == len(lesson_names(BOOKS))


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_copy_runs_where_it_lies(folders, monkeypatch):
    from nbclient import NotebookClient

    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    folder = folders[0]
    book = nbformat.read(folder / "04_destroying_a_dance.ipynb", 4)
    where = {"metadata": {"path": str(folder)}}
    NotebookClient(book, timeout=200, kernel_name="python3", resources=where).execute()
    assert set(grading.marks(book).values()) == {nb.OPEN}
