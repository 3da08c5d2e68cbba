"""All lessons as they are handed out, in JupyterLab: wide and narrow, light and dark, all is seen.

With ``DANCEDIFF_SHOTS`` a folder, pictures of all pages are kept there.
"""

import os
from pathlib import Path

import nbformat
import pytest
from chromium_page import SLOW, serve_lab, until

from places import BOOKS

pytest.importorskip("jupyterlab")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
LESSONS = sorted(path.stem for path in BOOKS.glob("[0-9]*.ipynb"))
WIDTHS = (1400, 900)
THEMES = {"light": "JupyterLab Light", "dark": "JupyterLab Dark"}
SETTINGS = """{
"@jupyterlab/notebook-extension:tracker": {"windowingMode": "none"},
"@jupyterlab/apputils-extension:notification": {"fetchNews": "false"}
}"""
OFTEN = ("favicon", "404 (Not Found)")  # of JupyterLab itself, not of a lesson
# what is wider than its place: cut off, or to be scrolled to
TOO_WIDE = """
[...document.querySelectorAll(
    '.jp-Notebook .jp-RenderedMarkdown, .jp-Notebook .jp-OutputArea-output')]
  .flatMap((box) => [box, ...box.querySelectorAll('mjx-container, table, pre, div')])
  .filter((box) => box.scrollWidth > box.clientWidth + 2 && box.clientWidth > 0)
  .filter((box) => getComputedStyle(box).overflowX !== 'visible')
  .map((box) => box.textContent.trim().slice(0, 80) || box.className)
"""
# light text on a light ground, or dark on dark
UNREADABLE = """
(() => {
  const light = (colour) => {
    const [r, g, b, a] = colour.match(/[\\d.]+/g).map(Number);
    return a === 0 ? null : (0.2126 * r + 0.7152 * g + 0.0722 * b) / 255;
  };
  const ground = (box) => {
    for (; box; box = box.parentElement) {
      const found = light(getComputedStyle(box).backgroundColor);
      if (found !== null) return found;
    }
    return 1;
  };
  const boxes = [...document.querySelectorAll(
    '.jp-Notebook .jp-RenderedMarkdown *, .jp-Notebook .jp-OutputArea-output *')];
  return boxes
    .filter((box) => [...box.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim()))
    .filter((box) => box.getClientRects().length)
    .filter((box) => Math.abs(light(getComputedStyle(box).color) - ground(box)) < 0.2)
    .map((box) => box.textContent.trim().slice(0, 80));
})()
"""


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A server with all lessons and their stored outputs."""
    folder = tmp_path_factory.mktemp("lab")
    settings = folder / "JUPYTER_CONFIG_DIR" / "labconfig"
    settings.mkdir(parents=True)
    (settings / "default_setting_overrides.json").write_text(SETTINGS)
    with serve_lab(folder, BOOKS / f"{LESSONS[0]}.ipynb") as address:
        for name in LESSONS:
            book = nbformat.read(BOOKS / f"{name}.ipynb", 4)
            book.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3"}
            nbformat.write(book, folder / "work" / f"{name}.ipynb")
        yield address


@pytest.mark.parametrize("name", LESSONS)
def test_all_of_a_lesson_is_seen(name, lab, new_page):
    page = new_page(WIDTHS[0], 1000)
    page.goto(f"{lab}/lab/tree/{name}.ipynb?reset")
    until(page, "document.querySelectorAll('.jp-Notebook .jp-Cell').length > 5", 60 * SLOW)
    page.evaluate("void window.jupyterapp.shell.collapseLeft()")
    found = {}
    for theme, title in THEMES.items():
        page.evaluate(
            "(theme) => void window.jupyterapp.commands"
            ".execute('apputils:change-theme', { theme })",
            title,
        )
        until(page, f"document.body.dataset.jpThemeName === '{title}'", 20 * SLOW)
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 1000})
            page.wait_for_timeout(1500)
            where = f"{theme} at {width}"
            if wide := page.evaluate(TOO_WIDE):
                found[f"too wide, {where}"] = wide
            if dim := page.evaluate(UNREADABLE):
                found[f"unreadable, {where}"] = dim
            keep(page, f"{name}_{width}_{theme}", width)
    complaints = [text for text in page.complaints if not any(word in text for word in OFTEN)]
    page.close()
    assert found == {}
    assert complaints == []


def keep(page, name: str, width: int) -> None:
    """A picture of the whole lesson, if somebody wants it."""
    if not (folder := os.environ.get("DANCEDIFF_SHOTS")):
        return
    Path(folder).mkdir(parents=True, exist_ok=True)
    height = page.evaluate("document.querySelector('.jp-WindowedPanel-inner').scrollHeight")
    page.set_viewport_size({"width": width, "height": min(height + 200, 15_000)})
    page.wait_for_timeout(1500)
    page.screenshot(path=Path(folder) / f"{name}.jpg", type="jpeg", quality=60)
