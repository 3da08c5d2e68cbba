"""Every loss of every step: a CSV, and TensorBoard's files where that is installed."""

import csv
import time
from pathlib import Path

from dancediff.atomic import atomic_write, hidden, writing


class LossLog:
    """The CSV of every loss of every step; on resuming, steps that will be run again are cut off.

    Beside an old CSV a new training begins in a hidden file, which takes its place at the first
    `flush`: the old one goes with the old checkpoint, and not before. Where there is none, it
    appears with its header at the first `write`: there is never an empty one.

    ``seconds`` is the training time so far, that of earlier runs included.
    """

    def __init__(self, path: Path | None, first: int = 0):
        """``path`` None: write nothing, only keep the time."""
        self.file = self.board = self.hidden = None
        self.path = path
        rows = []
        if path is None:
            self.started = time.monotonic()
            return
        if first and path.exists():
            lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
            rows = list(csv.reader(line for line in lines if line.endswith("\n")))  # whole ones
            rows = rows[:1] + [
                r
                for r in rows[1:]
                if len(r) == len(rows[0]) and r[0].isdigit() and int(r[0]) < first
            ]
        before = float(rows[-1][1]) if len(rows) > 1 else 0.0
        self.started = time.monotonic() - before
        if rows:
            _write_whole(path, rows)
        self.has_header = bool(rows)
        self.hidden = None if first or not path.exists() else hidden(path)
        self.board = tensorboard(path.parent / "tensorboard", first)

    @property
    def seconds(self) -> float:
        """Training time so far."""
        return time.monotonic() - self.started

    def flush(self) -> None:
        """Bring what was written to the disk."""
        if self.file:
            self.file.flush()
        if self.file and self.hidden:
            self.file.close()
            self.hidden.replace(self.path)
            self.file, self.hidden = _open(self.path, "a"), None

    def write(self, step: int, losses: dict[str, float]) -> None:
        """One line: step, seconds, losses."""
        if self.path is None:
            return
        if self.board:
            for name, value in losses.items():
                self.board.add_scalar(f"loss/{name}", value, step)
        if self.file is None:
            self._begin(["step", "seconds", *losses])
        values = (f"{value:.6g}" for value in losses.values())
        with writing(self.path):
            csv.writer(self.file).writerow([step, f"{self.seconds:.1f}", *values])

    def _begin(self, header: list[str]) -> None:
        path = self.hidden or self.path
        if not self.has_header:
            _write_whole(path, [header])
        self.file = _open(path, "a")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for file in (self.file, self.board):
            if file:
                file.close()
        if self.hidden:
            self.hidden.unlink(missing_ok=True)


def _write_whole(path: Path, rows: list[list[str]]) -> None:
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)


def _open(path: Path, mode: str):
    return path.open(mode, buffering=1, newline="", encoding="utf-8")  # whole lines


def tensorboard(folder: Path, first: int):
    """A writer that shows the steps from ``first`` on anew; None where TensorBoard is missing."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(folder, purge_step=first)
