"""What a saved notebook shows where a panel or a stage was."""

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.motion.motion import Motion
from dancediff.viz.still import NOTE, dance_png, still_html

pytest.importorskip("ipywidgets")


@pytest.fixture
def shown(monkeypatch):
    """All that is displayed, in order: data of what has any."""
    import IPython.display

    found = []

    def display(thing, raw=False, **options):
        found.append(thing if raw else thing.data)
        return type("Handle", (), {"update": lambda self, new: found.append(new.data)})()

    monkeypatch.setattr(IPython.display, "display", display)
    return found


def test_a_still_is_hidden_beside_a_living_widget():
    html = still_html(b"png")
    assert 'style="display:none"' in html and NOTE in html and "cG5n" in html
    assert ":has(*)" not in html  # browsers drop a rule with :has inside :has
    assert "<img" not in still_html(b"")


def test_a_dance_is_a_small_picture():
    dance = choreograph(np.arange(0.2, 5, 0.5), dancers=3, seed=1, seconds=5)[0]
    png = dance_png(dance)
    assert png.startswith(b"\x89PNG") and len(png) < 120_000


def test_a_dance_that_is_not_finite_is_shown_in_words():
    broken = Motion(torch.eye(3).expand(1, 9, 24, 3, 3), torch.full((1, 9, 3), float("nan")))
    assert "not finite" in broken._repr_mimebundle_()["text/html"]


def test_a_panel_shows_its_still_first_and_renews_it(shown):
    from dancediff.viz import panels

    def panel(width: float = 4.0):
        from matplotlib.figure import Figure

        return Figure(figsize=(width, 1))

    explorer = panels.explore(panel, width=panels.slider(2, 6, 4, "width"))
    explorer._ipython_display_()
    assert "dancediff-still" in shown[0]
    assert "application/vnd.jupyter.widget-view+json" in shown[1]
    explorer.controls["width"].value = 6
    assert len(shown) == 3 and "dancediff-still" in shown[2] and shown[2] != shown[0]


def test_a_stage_leaves_a_filmstrip(shown):
    pytest.importorskip("pythreejs")
    from dancediff.viz import stage

    dance = choreograph(np.arange(0.2, 3, 0.5), dancers=2, seed=1, seconds=1.0)[0]
    stage.stage(dance)._ipython_display_()
    assert "<img" in shown[0] and "application/vnd.jupyter.widget-view+json" in shown[1]
    stage.close_all()
