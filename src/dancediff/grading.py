"""Who solved what: marks read from executed lessons, and lessons with the solutions put in.

    python -m dancediff.nb grade FOLDER          # a folder a student, each with executed lessons

Marks are what `dancediff.nb.check` printed when the lesson was run; no student's code is run here.
Who does not trust the stored outputs runs the lesson again first.
"""

import re
from copy import deepcopy
from pathlib import Path

from dancediff.exercises import EXERCISES, OPEN, RIGHT, WRONG
from dancediff.exercises.solutions import solution_text

NOT_RUN = "·"
_CHECK = re.compile(r"nb\.check\(\s*[\"']([\d.]+)[\"']\s*,\s*(\w+)")


def checks(book: dict) -> list[tuple[int, str, str]]:
    """Every check of a notebook: number of its cell, exercise, name that is checked.

    >>> cell = {"cell_type": "code", "source": 'nb.check("04.1", x0_from)'}
    >>> checks({"cells": [cell]})
    [(0, '04.1', 'x0_from')]
    """
    found = []
    for k, cell in enumerate(book["cells"]):
        match = _CHECK.search("".join(cell["source"])) if cell["cell_type"] == "code" else None
        if match:
            found.append((k, match[1], match[2]))
    return found


def marks(book: dict) -> dict[str, str]:
    """The mark of every exercise of an executed notebook; "·" where the check was not run.

    >>> said = {"output_type": "stream", "text": "✗ 04.1 yours [0], expected [1]"}
    >>> cell = {"cell_type": "code", "source": 'nb.check("04.1", x0_from)', "outputs": [said]}
    >>> marks({"cells": [cell]})
    {'04.1': '✗'}
    """
    found = {}
    for k, exercise, _ in checks(book):
        outputs = book["cells"][k].get("outputs", ())
        said = "".join("".join(o.get("text", "")) for o in outputs)
        first = said.lstrip()[:1]
        found[exercise] = first if first in (OPEN, WRONG, RIGHT) else NOT_RUN
    return found


def with_solutions(book: dict) -> dict:
    """A copy of a lesson in which every stub is replaced by the solution.

    Raises: ValueError naming an exercise that has no stub before its check, or no solution.
    """
    book = deepcopy(book)
    for k, exercise, _ in checks(book):
        stubs = [c for c in book["cells"][:k] if "exercise" in c["metadata"].get("tags", [])]
        text = solution_text(exercise)
        if not stubs or not text:
            raise ValueError(f"exercise {exercise} has no {'solution' if stubs else 'stub'}")
        stubs[-1]["source"] = text
    return book


def grade(folder) -> list[dict]:
    """The marks of every notebook in a folder and the folders in it.

    A row is {"file", "marks"}; a file that is no notebook has "failed", why, instead of marks.
    Raises: FileNotFoundError when there is no such folder, ValueError when it has no notebook.
    """
    import nbformat

    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder}")
    files = sorted(p for p in folder.rglob("*.ipynb") if ".ipynb_checkpoints" not in p.parts)
    if not files:
        raise ValueError(f"{folder} has no notebook (*.ipynb) in it")
    rows = []
    for file in files:
        row: dict = {"file": str(file.relative_to(folder))}
        try:
            row["marks"] = marks(nbformat.read(file, 4))
        except Exception as err:  # a damaged file of one student must not stop the others
            row["failed"] = f"{type(err).__name__}: {err}"
        rows.append(row)
    return rows


def table(rows: list[dict]) -> str:
    """What `grade` found, to read: a line a notebook, then how many solved each exercise.

    >>> print(table([{"file": "ann/04.ipynb", "marks": {"04.1": "✓", "04.2": "○"}}]))
    ann/04.ipynb  1 of 2  ✓ 04.1  ○ 04.2
    <BLANKLINE>
    04.1  solved in 1 of 1  undo the noise
    04.2  solved in 0 of 1  walk on
    <BLANKLINE>
    ✓ right  ✗ wrong  ○ not attempted  · not run
    """
    wide = max(len(row["file"]) for row in rows)
    lines: list[str] = []
    tried: dict = {}
    for row in rows:
        if "failed" in row:
            lines.append(f"{row['file']:{wide}}  cannot be read: {row['failed']}")
            continue
        right = sum(mark == RIGHT for mark in row["marks"].values())
        each = "  ".join(f"{mark} {exercise}" for exercise, mark in row["marks"].items())
        lines.append(f"{row['file']:{wide}}  {right} of {len(row['marks'])}  {each}".rstrip())
        for exercise, mark in row["marks"].items():
            tried.setdefault(exercise, []).append(mark == RIGHT)
    lines.append("")
    for exercise in sorted(tried):
        title = EXERCISES[exercise].title if exercise in EXERCISES else "no exercise of the course"
        done = tried[exercise]
        lines.append(f"{exercise}  solved in {sum(done)} of {len(done)}  {title}")
    return "\n".join([*lines, "", f"{RIGHT} right  {WRONG} wrong  {OPEN} not attempted  · not run"])
