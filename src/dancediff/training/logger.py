"""The log of a training: a CSV, and what `dancediff.training.boards` shows of it."""

import csv
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TextIO

from dancediff.atomic import atomic_write, hidden, writing
from dancediff.training.boards import Board


class Logger:
    """One row a step: its number, seconds, losses, learning rate, length of the gradient.

    On resuming, steps that will be run again are cut off. Beside an old CSV a new training begins
    in a hidden file, which takes its place at the first `flush`: the old one goes with the old
    checkpoint, and not before. Where there is none, it appears with its header at the first
    `write`: there is never an empty one.

    ``path`` None: write nothing.  ``boards`` get every number, too; they are closed in the end.
    """

    def __init__(self, path: Path | None, first: int = 0, boards: Sequence[Board] = ()):
        self.path, self.boards = path, boards
        self.file: TextIO | None = None
        self.hidden: Path | None = None
        self.names: list[str] = []  # of the columns, but for step and seconds
        self.rows = _rows_before(path, first) if path is not None and first else []
        before = float(self.rows[-1]["seconds"]) if self.rows else 0.0
        self.started = time.monotonic() - before
        if path is not None:
            self.hidden = None if first or not path.exists() else hidden(path)

    def write(self, step: int, values: dict[str, float | None]) -> None:
        """One row; a value that is None stays empty.

        Raises: ValueError when the names are not those of the first row.
        """
        if self.path is None:
            return
        self.show(step, "train", values)
        file = self.file or self._begin(self.path, ["step", "seconds", *values])
        if list(values) != self.names:
            raise ValueError(
                f"step {step} has the columns {list(values)}, the log {self.names}; give every "
                "step the same ones, with None where there is nothing"
            )
        texts = ("" if value is None else f"{value:.6g}" for value in values.values())
        seconds = time.monotonic() - self.started
        with writing(self.path):
            csv.writer(file).writerow([step, f"{seconds:.1f}", *texts])

    def show(self, step: int, kind: str, values: Mapping[str, float | None]) -> None:
        """Numbers for the boards alone, named ``kind/name``."""
        known = {f"{kind}/{name}": one for name, one in values.items() if one is not None}
        for board in self.boards:
            board.add(step, known)

    def flush(self) -> None:
        """Bring what was written to the disk."""
        if self.file:
            self.file.flush()
        if self.path and self.file and self.hidden:
            self.file.close()
            self.hidden.replace(self.path)
            self.file, self.hidden = _open(self.path), None

    def _begin(self, path: Path, names: list[str]) -> TextIO:
        """Write the header, and the rows of before with its columns."""
        path, self.names = self.hidden or path, names[2:]
        with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, names, extrasaction="ignore")
            table.writeheader()
            table.writerows(self.rows)
        self.file = _open(path)
        return self.file

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for file in (self.file, *self.boards):
            if file:
                file.close()
        if self.hidden:
            self.hidden.unlink(missing_ok=True)


def _rows_before(path: Path, first: int) -> list[dict[str, str]]:
    """Whole rows of an old log whose step will not be run again."""
    if not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    table = csv.DictReader(line for line in lines if line.endswith("\n"))
    rows = [row for row in table if None not in row and None not in row.values()]
    return [row for row in rows if row["step"].isdigit() and int(row["step"]) < first]


def _open(path: Path) -> TextIO:
    return path.open("a", buffering=1, newline="", encoding="utf-8")  # whole lines
