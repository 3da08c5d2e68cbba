"""Panels in a real JupyterLab: they dance in the background, stop, and dancers can be dragged."""

import pytest
from chromium_page import SLOW, changed, num_colors, open_notebook, picture, serve_lab, until

pytest.importorskip("jupyterlab")
pytest.importorskip("pythreejs")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]
CELLS = (
    """
import time
import numpy as np
from matplotlib.figure import Figure
from dancediff.data.choreographer import choreograph
from dancediff.viz import panels
from dancediff.viz.floor_plan import FloorPlan

def panel(start, seed, report):
    for step in range(30):
        report(step, 30)
        time.sleep(0.1)
    dance = choreograph(np.arange(0.2, 2, 0.5), dancers=2, seed=seed, seconds=2)[0]
    figure = Figure(figsize=(4, 1))
    figure.suptitle(f"seed {seed} from {start[1][0]:.2f}")
    return figure, dance
""",
    """
plan = FloorPlan([(-1, 0), (1, 0)])
box = panels.explore(panel, start=plan, seed=panels.slider(0, 9, 0, "seed"))
box
""",
)
IMAGES = "[...document.querySelectorAll('img.widget-image')].filter(i => i.naturalWidth > 0)"


@pytest.fixture(scope="module")
def notebook(chromium, new_page, tmp_path_factory):
    with serve_lab(tmp_path_factory.mktemp("lab"), CELLS) as address:
        page = new_page(1300, 1600)
        open_notebook(page, address, len(CELLS))
        for _ in CELLS:
            page.keyboard.press("Shift+Enter")
        until(page, "document.querySelectorAll('g[data-dancer]').length == 2", 30 * SLOW)
        page.keyboard.press("Escape")
        page.wait_for_timeout(500 * SLOW)
        yield page
        page.close()


def press(page, button):
    page.locator(f"button:visible:has-text('{button}')").first.click()


def drag(page, dancer, metres):
    disc = page.locator(f"g[data-dancer='{dancer}']").first.bounding_box()
    x, y = disc["x"] + disc["width"] / 2, disc["y"] + disc["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.wait_for_timeout(200)
    for part in range(1, 11):
        page.mouse.move(x + 60 * metres * part / 10, y)
    page.mouse.up()


def test_it_is_in_no_hurry_and_can_be_stopped(notebook):
    assert notebook.evaluate(f"{IMAGES}.length") == 0
    press(notebook, "Dance")
    until(notebook, "!!document.querySelector('.progress-bar')?.offsetWidth", 10 * SLOW)
    press(notebook, "Cancel")
    until(notebook, "document.body.innerText.includes('cancelled')", 10 * SLOW)
    notebook.wait_for_timeout(4000)
    assert notebook.evaluate(f"{IMAGES}.length") == 0


def test_a_dragged_dancer_is_one_message_and_a_new_dance(notebook):
    press(notebook, "Dance")
    until(notebook, f"{IMAGES}.length == 1", 20 * SLOW)
    notebook.wait_for_timeout(500 * SLOW)
    before, sent = picture(notebook, "img.widget-image"), len(notebook.sent)
    drag(notebook, 1, 0.5)
    at = "document.querySelector('g[data-dancer=\"1\"]').getAttribute('transform')"
    until(notebook, f"{at} == 'translate(240 150)'", 10 * SLOW)
    source = notebook.evaluate(f"{IMAGES}[0].src")
    until(notebook, f"{IMAGES}.length && {IMAGES}[0].src != '{source}'", 20 * SLOW)
    assert changed(before, picture(notebook, "img.widget-image")) > 0
    texts = [frame for frame in notebook.sent[sent:] if b"1.5" in _bytes(frame)]
    assert len(texts) == 1


def _bytes(frame) -> bytes:
    return frame if isinstance(frame, bytes) else frame.encode()


def test_a_dance_can_be_watched_beside_the_pinned_one(notebook):
    press(notebook, "Pin as A")
    until(notebook, f"{IMAGES}.length == 2", 10 * SLOW)
    drag(notebook, 1, 0.25)
    source = notebook.evaluate(f"{IMAGES}[0].src")
    until(notebook, f"{IMAGES}[0].src != '{source}'", 20 * SLOW)
    press(notebook, "Watch")
    canvas = ".jupyter-threejs canvas"
    until(notebook, f"!!document.querySelector('{canvas}') && window.dancediff", 30 * SLOW)
    notebook.wait_for_timeout(1000 * SLOW)
    assert num_colors(picture(notebook, canvas)) > 200
    assert notebook.locator("text=on the right: 2 dancers").count() == 1


def test_nobody_complains(notebook):
    assert [text for text in notebook.complaints if "lumino" not in text] == []


def test_a_saved_panel_leaves_a_still_picture(notebook):
    """Last in this file: the kernel ends. The notebook is saved, and opened again without it."""
    assert not notebook.locator(".dancediff-still").first.is_visible()  # the panel is alive
    notebook.keyboard.press("Control+s")
    notebook.wait_for_timeout(1000 * SLOW)
    origin = "location.origin"
    notebook.evaluate(
        f"""async () => {{
        const token = document.cookie.match(/_xsrf=([^;]+)/)?.[1] ?? "";
        const list = await (await fetch({origin} + "/api/sessions")).json();
        const end = {{ method: "DELETE", headers: {{ "X-XSRFToken": token }} }};
        for (const one of list) await fetch({origin} + "/api/sessions/" + one.id, end);
    }}"""
    )
    notebook.reload()
    until(notebook, "document.querySelector('.dancediff-still')?.offsetHeight > 0", 60 * SLOW)
    still = notebook.locator(".dancediff-still").first
    assert "run this cell" in still.inner_text()
    assert num_colors(picture(notebook, ".dancediff-still img")) > 10
    lost = notebook.locator("text=Error displaying widget")
    assert not any(lost.nth(k).is_visible() for k in range(lost.count()))
