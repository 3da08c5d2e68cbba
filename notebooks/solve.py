"""Copies of the lessons with all solutions put in: `python notebooks/solve.py FOLDER`.

A teacher's set, and what `make test` runs besides the lessons as they are.
"""

import sys
from pathlib import Path

import nbformat

from dancediff.grading import with_solutions

HERE = Path(__file__).parent


def main(folder: Path) -> None:
    """Write every lesson into a folder; outputs are those without solutions until it is run."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in sorted(HERE.glob("[0-9]*.ipynb")):
        nbformat.write(with_solutions(nbformat.read(path, 4)), folder / path.name)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
