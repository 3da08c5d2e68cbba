"""What the browser tests share: JupyterLab, waiting for a page, and looking at pictures of it."""

import io
import os
import socket
import subprocess
import sys
import time
from contextlib import closing, contextmanager
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

import numpy as np
from PIL import Image

SLOW = float(os.environ.get("DANCEDIFF_SLOW", "4"))  # how many times longer a busy machine may take


def until(page, what: str, seconds: float = 60.0) -> None:
    """Wait until an expression is true; Playwright's own way is stopped by a page's policy."""
    for _ in range(round(seconds * 10)):
        if page.evaluate(what):
            return
        page.wait_for_timeout(100)
    raise AssertionError(f"in {seconds:g} s it did not become true that {what}")


def picture(page, selector: str) -> np.ndarray:
    """What the first such element looks like, (height, width, 3)."""
    return shot(page.locator(selector).first)


def shot(element) -> np.ndarray:
    """What an element looks like, (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(element.screenshot())).convert("RGB")).astype(int)


def changed(a: np.ndarray, b: np.ndarray) -> float:
    """Share of the pixels that are another colour.

    Of what both pictures show: a line more in a panel makes a stage lower.
    """
    rows, columns = (min(sizes) for sizes in zip(a.shape[:2], b.shape[:2], strict=True))
    return (np.abs(a[:rows, :columns] - b[:rows, :columns]).max(-1) > 24).mean()


def num_colors(image: np.ndarray) -> int:
    """How many colours there are; a blank page has one."""
    return len(np.unique(image.reshape(-1, 3), axis=0))


@contextmanager
def serve_lab(folder, cells):
    """A JupyterLab on 127.0.0.1 with one notebook; gives its address.

    ``cells``: the code of its cells, or the path of a notebook, whose outputs are left out.
    """
    import nbformat

    if isinstance(cells, Path):
        book = nbformat.read(cells, 4)
        for cell in book.cells:
            if cell.cell_type == "code":
                cell.update(outputs=[], execution_count=None)
    else:
        code = [nbformat.v4.new_code_cell(cell.strip()) for cell in cells]
        book = nbformat.v4.new_notebook(cells=code)
    book.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3"}  # else Lab asks
    (folder / "work").mkdir()
    nbformat.write(book, folder / "work" / "test.ipynb")
    with closing(socket.socket()) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    own = ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR")
    command = [
        *(sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root"),
        *("--ip=127.0.0.1", f"--port={port}", "--ServerApp.port_retries=0"),
        *("--IdentityProvider.token=", "--LabApp.news_url=", "--expose-app-in-browser"),
        f"--ServerApp.root_dir={folder / 'work'}",
    ]
    with (folder / "log.txt").open("w") as log:
        env = os.environ | {name: str(folder / name) for name in own}
        server = subprocess.Popen(command, env=env, stdout=log, stderr=log)
    try:
        _wait_for(f"http://127.0.0.1:{port}/api", server, folder / "log.txt")
        yield f"http://127.0.0.1:{port}"
    finally:
        server.terminate()
        server.wait(30)


def _wait_for(url, server, log):
    for _ in range(round(30 * SLOW)):
        assert server.poll() is None, log.read_text()
        try:
            return urlopen(url, timeout=10).close()
        except URLError:
            time.sleep(1)
    raise AssertionError(f"JupyterLab does not answer:\n{log.read_text()}")


def open_notebook(page, address: str, cells: int) -> None:
    """Go to the notebook, wait for its kernel, and select its first cell."""
    page.goto(f"{address}/lab/tree/test.ipynb?reset")
    all_there = f"document.querySelectorAll('.jp-Notebook .jp-CodeCell').length == {cells}"
    until(page, all_there, 30 * SLOW)
    # the kernel is there once its name has a round beside it that says Idle
    until(page, "document.body.innerText.includes('| Idle')", 30 * SLOW)
    page.locator(".jp-Notebook .jp-CodeCell").first.click()
