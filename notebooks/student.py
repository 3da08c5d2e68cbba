"""The lessons to hand out: `python notebooks/student.py FOLDER`, or for teachers `--key FOLDER`.

Students get them without stored outputs, since the answers to predictions stand in those, and
without solutions. The key has the solutions put in, and key.md: each exercise and why it is so.
A lesson of the key has the outputs of the lesson without solutions until it is run. `make test`
runs what `--both FOLDER` writes: lessons as they are, with each exercise solved after its stub.
"""

import argparse
import re
from pathlib import Path

import nbformat

from dancediff.exercises import EXERCISES
from dancediff.exercises.solutions import solution_text
from dancediff.grading import checks, open_then_solved, with_solutions

HERE = Path(__file__).parent
LESSONS = sorted(HERE.glob("[0-9]*.ipynb"))
# links out of the folder; the brackets around one, if nothing else is in them, go with it
ELSEWHERE = re.compile(r"( \()?\[([^\]]*)\]\(\.\./[^)]*\)(?(1)\))")


def for_students(book):
    """A lesson without outputs, and with links to nothing but the other lessons."""
    for cell in book.cells:
        cell.source = ELSEWHERE.sub(lambda link: "" if link[1] else link[2], cell.source)
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    return book


def key_page(books: dict) -> str:
    """All exercises with their answers, as Markdown."""
    parts = ["# Answers to the exercises"]
    for name, book in books.items():
        parts.append(f"## {name}")
        for _, exercise, _ in checks(book):
            title = EXERCISES[exercise].title
            parts.append(f"### {exercise} {title}\n\n```python\n{solution_text(exercise)}\n```")
    return "\n\n".join(parts) + "\n"


KINDS = {"students": for_students, "key": with_solutions, "both": open_then_solved}


def main(folder: Path, kind: str = "students") -> None:
    """Write all lessons into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    books = {path.stem: nbformat.read(path, 4) for path in LESSONS}
    for name, book in books.items():
        nbformat.write(KINDS[kind](book), folder / f"{name}.ipynb")
    if kind == "key":
        (folder / "key.md").write_text(key_page(books), encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    what = {"dest": "kind", "action": "store_const", "default": "students"}
    parser.add_argument("--key", const="key", help="with the solutions, for teachers", **what)
    parser.add_argument("--both", const="both", help="each exercise open, then solved", **what)
    options = parser.parse_args()
    main(options.folder, options.kind)
