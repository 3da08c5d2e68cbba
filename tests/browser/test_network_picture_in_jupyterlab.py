"""The picture of a network in JupyterLab: it is seen, and a click on a part opens its lesson."""

import nbformat
import pytest
from chromium_page import SLOW, num_colors, open_notebook, serve_lab, shot, until

pytest.importorskip("jupyterlab")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]
CELLS = (
    """
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.viz.network_picture import network_picture
sizes = TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=32)
network_picture(TCDiffPP(sizes), lit="fusion_projection")
""",
)
LESSON = "07_who_stands_where.ipynb"
IMAGE = ".jp-RenderedHTML img"


def test_a_click_opens_the_lesson(new_page, tmp_path):
    with serve_lab(tmp_path, CELLS) as address:
        nbformat.write(nbformat.v4.new_notebook(), tmp_path / "work" / LESSON)
        page = new_page(1200, 900)
        open_notebook(page, address, len(CELLS))
        page.keyboard.press("Shift+Enter")
        until(page, f"document.querySelector('{IMAGE}')?.naturalWidth > 0", 30 * SLOW)
        assert num_colors(shot(page.locator(IMAGE).first)) > 20
        page.locator("a[title^='Fusion Projection']").first.click()
        opened = f"window.jupyterapp.shell.currentWidget?.context?.path === '{LESSON}'"
        until(page, opened, 30 * SLOW)
        page.close()
