"""Run the lessons in place and store what a reader should see: `python notebooks/refresh.py [NN ...]`.

With --keep-times, for a machine that is busy with something else, times stay as they were.

Outputs are kept (they are the shop window), widget states, timings and cells tagged "widget" are
not: they would be large, or dead without a kernel. Pictures are stored with a palette. How long a
lesson took on one core goes into docs/results/lessons.json, and from there, rounded up to five
seconds, into its first line: nobody writes that by hand.
"""

import argparse
import base64
import io
import json
import math
import os
import re
import time
from datetime import datetime
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

HERE = Path(__file__).parent
TIMES = HERE.parent / "docs" / "results" / "lessons.json"
COLOURS = 256
SLOW = 5  # seconds of a cell
VIEW = "application/vnd.jupyter.widget-view+json"


def refresh(path: Path, *, keep_times: bool = False) -> float:
    """Execute one notebook and write it back; seconds it took. Nothing is written if it fails."""
    os.environ["OMP_NUM_THREADS"] = "1"  # of the kernel: the badge says one core
    book = nbformat.read(path, 4)
    start = time.perf_counter()
    NotebookClient(
        book,
        timeout=120,
        kernel_name="python3",
        store_widget_state=False,
        coalesce_streams=True,
        record_timing=True,
        resources={"metadata": {"path": str(HERE)}},
    ).execute()
    seconds = time.perf_counter() - start
    for number, cell in enumerate(book.cells):
        if (took := cell_seconds(cell)) > SLOW:
            print(f"  cell {number} took {took:.0f} s: does it show its progress?")
        tidy(cell)
    book.metadata.pop("widgets", None)
    book.metadata["language_info"] = {"name": "python"}
    if not keep_times:
        store_time(path.name[:2], math.ceil(seconds))
    head = book.cells[0]
    head.source = re.sub(r"⏱ [^—]+ —", f"⏱ {badge(stored_time(path.name[:2]))} —", head.source)
    part = path.with_suffix(".part")
    nbformat.write(book, part)
    part.replace(path)
    return seconds


def cell_seconds(cell) -> float:
    """How long a cell ran, by the times that its execution noted; they are taken out of it.

    >>> noted = {"iopub.execute_input": "2030-01-01T00:00:01Z", "shell.execute_reply":
    ...     "2030-01-01T00:00:08Z"}
    >>> cell_seconds(nbformat.v4.new_code_cell(metadata={"execution": noted}))
    7.0
    """
    noted = cell.metadata.pop("execution", {})
    times = [noted.get(name) for name in ("iopub.execute_input", "shell.execute_reply")]
    if None in times:
        return 0.0
    begin, end = (datetime.fromisoformat(text) for text in times)
    return (end - begin).total_seconds()


def badge(seconds: int) -> str:
    """What a lesson's first line says of its time: seconds rounded up to five, and the cores.

    >>> badge(14)
    '15 s · 1 core'
    """
    return f"{5 * math.ceil(seconds / 5)} s · 1 core"


def stored_time(lesson: str) -> int:
    """Seconds that a lesson, such as "07", took when it was last timed."""
    return dict(json.loads(TIMES.read_text(encoding="utf-8"))["rows"])[lesson]


def store_time(lesson: str, seconds: int) -> None:
    """Write a lesson's seconds into docs/results/lessons.json."""
    entry = f'["{lesson}", {seconds}]'
    times = TIMES.read_text(encoding="utf-8")
    TIMES.write_text(re.sub(rf'\["{lesson}", \d+\]', entry, times), encoding="utf-8")


def tidy(cell) -> None:
    """Keep of a cell's outputs what a page without a kernel can show."""
    if cell.cell_type != "code":
        return
    if "widget" in cell.metadata.get("tags", []):
        cell.outputs = []
    # a progress bar or a panel is dead without its kernel
    cell.outputs = [out for out in cell.outputs if VIEW not in out.get("data", {})]
    for output in cell.outputs:
        data = output.get("data", {})
        if "image/png" in data:
            data["image/png"] = shrink(data["image/png"])
            data["text/plain"] = "<Figure>"


def shrink(png: str) -> str:
    """The same picture with a palette, base64 to base64."""
    picture = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB")
    file = io.BytesIO()
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return base64.b64encode(file.getvalue()).decode()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Run lessons in place.")
    parser.add_argument("lessons", nargs="*", default=[""], help="such as 05 09; all unless given")
    parser.add_argument("--keep-times", action="store_true", help="the machine is busy")
    asked = parser.parse_args()
    for book_path in sorted(p for n in asked.lessons for p in HERE.glob(f"{n}*.ipynb")):
        seconds = refresh(book_path, keep_times=asked.keep_times)
        print(f"{book_path.name}: {seconds:.0f} s, {book_path.stat().st_size // 1024} kB")
