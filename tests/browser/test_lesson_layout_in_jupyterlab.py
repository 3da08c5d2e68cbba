"""All lessons as they are handed out, in JupyterLab: wide and narrow, light and dark, all is seen.

By default wide and light, and narrow and dark. With ``DANCEDIFF_SHOTS`` a folder both widths are
looked at in both themes, and pictures of all pages are kept there.
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
KEPT = os.environ.get("DANCEDIFF_SHOTS")
LOOKS = [(1400, "light"), (900, "dark"), *([(900, "light"), (1400, "dark")] if KEPT else [])]
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
# MathJax's copy of each equation for screen readers, unseen, is as wide as the system's font for it
UNSEEN = "body mjx-container mjx-assistive-mml { display: none !important }"
# without a question whether to save
CLOSE_ALL = """
[...window.jupyterapp.shell.widgets('main')].forEach((one) => {
  if (one.context) one.context.model.dirty = false;
  one.close();
})
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
def lab(new_page, tmp_path_factory):
    """A page of JupyterLab whose folder has all lessons with their stored outputs."""
    folder = tmp_path_factory.mktemp("lab")
    settings = folder / "JUPYTER_CONFIG_DIR" / "labconfig"
    settings.mkdir(parents=True)
    (settings / "default_setting_overrides.json").write_text(SETTINGS)
    with serve_lab(folder, BOOKS / f"{LESSONS[0]}.ipynb") as address:
        for name in LESSONS:
            book = nbformat.read(BOOKS / f"{name}.ipynb", 4)
            book.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3"}
            nbformat.write(book, folder / "work" / f"{name}.ipynb")
        page = new_page(1400, 1000)
        page.goto(f"{address}/lab?reset")
        until(page, "window.jupyterapp !== undefined", 60 * SLOW)
        page.evaluate("window.jupyterapp.restored.then(() => true)")  # before, nothing opens
        page.evaluate("void window.jupyterapp.shell.collapseLeft()")
        page.add_style_tag(content=UNSEEN)
        yield page
        page.close()


def command(page, name: str, arguments: dict) -> None:
    """Start one of JupyterLab's commands."""
    run = "([name, given]) => void window.jupyterapp.commands.execute(name, given)"
    page.evaluate(run, [name, arguments])


@pytest.mark.parametrize("name", LESSONS)
def test_all_of_a_lesson_is_seen(name, lab):
    lab.complaints.clear()
    lab.evaluate(CLOSE_ALL)
    command(lab, "docmanager:open", {"path": f"{name}.ipynb"})
    cells = len(nbformat.read(BOOKS / f"{name}.ipynb", 4).cells)
    until(lab, f"document.querySelectorAll('.jp-Notebook .jp-Cell').length === {cells}", 60 * SLOW)
    found = {}
    for width, theme in LOOKS:
        command(lab, "apputils:change-theme", {"theme": THEMES[theme]})
        until(lab, f"document.body.dataset.jpThemeName === '{THEMES[theme]}'", 20 * SLOW)
        lab.set_viewport_size({"width": width, "height": 1000})
        lab.wait_for_timeout(300 * SLOW)
        if wide := lab.evaluate(TOO_WIDE):
            found[f"too wide, {theme} at {width}"] = wide
        if dim := lab.evaluate(UNREADABLE):
            found[f"unreadable, {theme} at {width}"] = dim
        keep(lab, f"{name}_{width}_{theme}", width)
    assert found == {}
    assert [text for text in lab.complaints if not any(word in text for word in OFTEN)] == []


def keep(page, name: str, width: int) -> None:
    """A picture of the whole lesson, if somebody wants it."""
    if not KEPT:
        return
    Path(KEPT).mkdir(parents=True, exist_ok=True)
    height = page.evaluate("document.querySelector('.jp-WindowedPanel-inner').scrollHeight")
    page.set_viewport_size({"width": width, "height": min(height + 200, 15_000)})
    page.wait_for_timeout(1500)
    page.screenshot(path=Path(KEPT) / f"{name}.jpg", type="jpeg", quality=60)


def test_what_is_cut_off_or_dim_is_found(lab):
    """The checks themselves: a wide table and grey on grey."""
    until(lab, "document.querySelector('.jp-Notebook .jp-RenderedMarkdown') !== null", 20 * SLOW)
    lab.evaluate(
        """() => { document.querySelector('.jp-Notebook .jp-RenderedMarkdown').innerHTML =
        '<div style="overflow-x:auto; width:200px"><pre style="width:900px">wide</pre></div>'
        + '<p style="color:#777; background:#888">dim</p>'; }"""
    )
    assert any("wide" in text for text in lab.evaluate(TOO_WIDE))
    assert lab.evaluate(UNREADABLE) == ["dim"]
