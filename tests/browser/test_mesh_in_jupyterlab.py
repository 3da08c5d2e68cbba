"""The mesh body on the notebooks' stage: its skin is where the mannequin's limbs are."""

import chromium_page
import numpy as np
import pytest
from chromium_page import SLOW, open_notebook, serve_lab, until

pytest.importorskip("jupyterlab")
pytest.importorskip("pythreejs")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]
CELLS = (
    """
import numpy as np
from dancediff.data.choreographer import choreograph
from dancediff.viz.stage import stage
dance = choreograph(np.arange(0.2, 6, 0.5), dancers=3, seed=1, seconds=6.0)[0]
""",
    "stage(dance, size=(560, 320))",
    "stage(dance, body='mesh', size=(560, 320))",
)


@pytest.fixture(scope="module")
def notebook(chromium, new_page, tmp_path_factory):
    with serve_lab(tmp_path_factory.mktemp("lab"), CELLS) as address:
        page = new_page(1300, 1500)
        page.errors = []
        page.on("pageerror", lambda error: page.errors.append(str(error)))
        open_notebook(page, address, len(CELLS))
        for count in range(len(CELLS)):
            page.keyboard.press("Shift+Enter")
            found = "document.querySelectorAll('.jupyter-threejs canvas').length"
            until(page, f"{found} >= {count}", 30 * SLOW)
        for box in page.locator(".widget-checkbox input").all():
            box.uncheck()  # trails and contacts have colours, too
        page.wait_for_timeout(1000 * SLOW)
        yield page
        page.close()


def bodies(page, number):
    """Where the dancers' colours are: few other things on the stage have a colour."""
    canvas = page.locator(".jupyter-threejs canvas").nth(number)
    canvas.scroll_into_view_if_needed()
    page.wait_for_timeout(300 * SLOW)
    image = chromium_page.shot(canvas)
    return np.ptp(image, axis=-1) > 50


@pytest.mark.parametrize("share", [0.0, 0.4, 0.9])
def test_the_skin_covers_the_mannequin(notebook, share):
    seen = []
    for number in range(2):
        slider = notebook.locator(".noUi-target").nth(number)
        slider.scroll_into_view_if_needed()
        way = slider.bounding_box()
        notebook.mouse.click(way["x"] + share * way["width"], way["y"] + way["height"] / 2)
        seen.append(bodies(notebook, number))
    mannequin, mesh = seen
    assert mannequin.mean() > 0.01
    assert (mannequin & mesh).sum() / (mannequin | mesh).sum() > 0.6
    moved = np.roll(mesh, 40, axis=1)  # what a skin scores that does not follow
    assert (mannequin & moved).sum() / (mannequin | moved).sum() < 0.3
    assert not notebook.errors
