"""Run the lessons in place and store what a reader should see: `python notebooks/refresh.py [NN ...]`.

Outputs are kept (they are the shop window), widget states, timings and cells tagged "widget" are
not: they would be large, or dead without a kernel. Pictures are stored with a palette. How long a
lesson took goes into docs/results/lessons.json and, rounded up to five seconds, into its first line.
"""

import base64
import io
import math
import re
import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

HERE = Path(__file__).parent
TIMES = HERE.parent / "docs" / "results" / "lessons.json"
COLOURS = 256
VIEW = "application/vnd.jupyter.widget-view+json"


def refresh(path: Path) -> float:
    """Execute one notebook and write it back; seconds it took. Nothing is written if it fails."""
    book = nbformat.read(path, 4)
    start = time.perf_counter()
    NotebookClient(
        book,
        timeout=120,
        kernel_name="python3",
        store_widget_state=False,
        record_timing=False,
        resources={"metadata": {"path": str(HERE)}},
    ).execute()
    for cell in book.cells:
        tidy(cell)
    book.metadata.pop("widgets", None)
    book.metadata["language_info"] = {"name": "python"}
    seconds = time.perf_counter() - start
    book.cells[0].source = re.sub(r"⏱ \d+ s", f"⏱ {badge(seconds)} s", book.cells[0].source)
    part = path.with_suffix(".part")
    nbformat.write(book, part)
    part.replace(path)
    times = TIMES.read_text(encoding="utf-8")
    entry = f'["{path.name[:2]}", {math.ceil(seconds)}]'
    TIMES.write_text(re.sub(rf'\["{path.name[:2]}", \d+\]', entry, times), encoding="utf-8")
    return seconds


def badge(seconds: float) -> int:
    """Seconds that a lesson's first line promises: rounded up to five."""
    return 5 * math.ceil(math.ceil(seconds) / 5)


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
    chosen = sys.argv[1:] or [""]
    for book_path in sorted(p for n in chosen for p in HERE.glob(f"{n}*.ipynb")):
        seconds = refresh(book_path)
        print(f"{book_path.name}: {seconds:.0f} s, {book_path.stat().st_size // 1024} kB")
