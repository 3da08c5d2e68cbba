"""The marks of all notebooks in a folder.

Marks are what `dancediff.nb.check` printed when a lesson was run; no student's code is run here.
`dancediff.grading.replay` judges the answers again instead.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path

from dancediff.exercises import OPEN, RIGHT, WRONG

NOT_RUN = "·"
_CHECK = re.compile(r"nb\.check\(\s*[\"']([\d.]+)[\"']\s*,\s*(\w+)")


def checks(book: dict) -> list[tuple[int, str, str]]:
    """Every check of a notebook: number of its cell, exercise, name that is checked.

    >>> cell = {"cell_type": "code", "source": 'nb.check("04.1", x0_from)'}
    >>> checks({"cells": [cell]})
    [(0, '04.1', 'x0_from')]
    """
    return [
        (k, match[1], match[2])
        for k, cell in enumerate(book["cells"])
        if cell["cell_type"] == "code"
        for match in _CHECK.finditer("".join(cell["source"]))
    ]


def marks(book: dict) -> dict[str, str]:
    """The mark of every exercise of an executed notebook; "·" where the check was not run.

    Of several checks of an exercise the last one that was run counts.

    >>> said = {"output_type": "stream", "text": "✗ 04.1 yours [0], expected [1]"}
    >>> cell = {"cell_type": "code", "source": 'nb.check("04.1", x0_from)', "outputs": [said]}
    >>> marks({"cells": [cell]})
    {'04.1': '✗'}
    """
    found: dict[str, str] = {}
    for k, exercise, _ in checks(book):
        outputs = book["cells"][k].get("outputs", ())
        said = "".join("".join(o.get("text", "")) for o in outputs)
        verdicts = re.findall(f"([{OPEN}{WRONG}{RIGHT}]) {re.escape(exercise)} ", said)
        found[exercise] = verdicts[-1] if verdicts else found.get(exercise, NOT_RUN)
    return found


def stored(path: Path) -> dict[str, str]:
    """The marks that stand in a notebook's outputs."""
    return marks(read_book(path))


def read_book(path: Path) -> dict:
    """A notebook as a dict.

    Raises: ValueError naming the file when it holds no notebook.
    """
    try:
        book = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as err:
        raise ValueError(f"{path} holds no JSON ({err}); save it as a notebook again") from err
    cells = book.get("cells") if isinstance(book, dict) else None
    if not isinstance(cells, list) or not all(map(_is_cell, cells)):
        raise ValueError(
            f"{path} is JSON but no notebook of version 4, with a list of cells; save it as one"
        )
    return book


def _is_cell(cell) -> bool:
    """Whether it has what `checks` and `marks` look at; a source is a text or its lines."""
    if not isinstance(cell, dict) or "cell_type" not in cell:
        return False
    outputs = cell.get("outputs", [])
    if cell["cell_type"] != "code" or not isinstance(outputs, list):
        return cell["cell_type"] != "code"
    texts = [one.get("text", "") if isinstance(one, dict) else None for one in outputs]
    return all(map(_is_text, [cell.get("source"), *texts]))


def _is_text(text) -> bool:
    lines = isinstance(text, list) and all(isinstance(line, str) for line in text)
    return lines or isinstance(text, str)


def grade(folder, read: Callable[[Path], dict[str, str]] = stored) -> list[dict]:
    """The marks of every notebook in a folder and the folders in it.

    ``read`` finds the marks of one file. A row is {"file", "marks"}; a file that is no notebook has
    "failed", why, instead of marks.
    Raises: FileNotFoundError when there is no such folder, ValueError when it is a file or has no
    notebook.
    """
    folder = Path(folder)
    if folder.is_file():
        raise ValueError(f"{folder} is a file; give its folder, {folder.parent}")
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder}")
    files = sorted(p for p in folder.rglob("*.ipynb") if ".ipynb_checkpoints" not in p.parts)
    if not files:
        raise ValueError(f"{folder} has no notebook (*.ipynb) in it")
    rows = []
    for file in files:
        row: dict = {"file": str(file.relative_to(folder))}
        try:
            row["marks"] = read(file)
        except Exception as err:  # a damaged file of one student must not stop the others
            row["failed"] = f"{type(err).__name__}: {err}"
        rows.append(row)
    return rows
