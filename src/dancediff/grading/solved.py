"""Lessons with the solutions put in."""

import re
from copy import deepcopy

from dancediff.exercises.solutions import solution_text
from dancediff.grading.marks import checks


def with_solutions(book: dict) -> dict:
    """A copy of a lesson in which every stub is replaced by the solution.

    Raises: ValueError naming an exercise that has no stub before its check, or no solution.
    """
    book = deepcopy(book)
    for k, exercise, _ in checks(book):
        _stub(book, k, exercise)["source"] = solution_text(exercise)
    return book


def open_then_solved(book: dict) -> dict:
    """A copy of a lesson that leaves every exercise open first, and then solves it.

    After the last cell that takes an answer, by `nb.answer`, follow the solution, its check and
    that cell once more: one run sees the lesson as it is and with its exercises solved.

    Raises: ValueError naming an exercise that has no stub before its check, or no solution.
    """
    book = deepcopy(book)
    cells, after = book["cells"], {}
    for k, exercise, _ in checks(book):
        taken = re.compile(rf"nb\.answer\(\s*[\"']{re.escape(exercise)}[\"']")
        takers = [j for j, cell in enumerate(cells) if taken.search("".join(cell["source"]))]
        again = deepcopy([_stub(book, k, exercise), *(cells[j] for j in (k, *takers))])
        again[0]["source"] = solution_text(exercise)
        for number, cell in enumerate(again):
            cell["id"] = f"solved-{exercise.replace('.', '-')}-{number}"
        after[max(k, *takers, k)] = again
    book["cells"] = [c for j, cell in enumerate(cells) for c in (cell, *after.get(j, ()))]
    return book


def _stub(book: dict, k: int, exercise: str) -> dict:
    """The stub of an exercise whose check is cell k."""
    stubs = [c for c in book["cells"][:k] if "exercise" in c["metadata"].get("tags", [])]
    if not stubs or not solution_text(exercise):
        raise ValueError(f"exercise {exercise} has no {'solution' if stubs else 'stub'}")
    return stubs[-1]
