"""The notebooks' stage in a real JupyterLab: it appears, plays, scrubs, and sends nothing.

The server listens on 127.0.0.1 only, with a configuration of its own in a temporary folder. Times
are for a calm machine; DANCEDIFF_SLOW is how many times longer a busy one may take (default 4).
"""

import time
from urllib.parse import urlsplit

import chromium_page
import pytest
from chromium_page import SLOW, changed, num_colors, open_notebook, serve_lab, until

pytest.importorskip("jupyterlab")
pytest.importorskip("pythreejs")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]
CELLS = (
    """
from dancediff.data.choreographer import choreograph
from dancediff.music.synth import synth_song
from dancediff.viz.stage import stage
song, truth = synth_song(3, seconds=30.0)
dance = choreograph(truth.beats, dancers=5, seed=1, seconds=30.0)[0]
len(song.beats())
""",
    "stage(dance, song)",
    "from dancediff.viz.stage import close_all; close_all()",
)
STATE = "window.dancediff.state()"


@pytest.fixture(scope="module")
def lab(chromium, tmp_path_factory):
    """Address of a JupyterLab with one notebook."""
    with serve_lab(tmp_path_factory.mktemp("lab"), CELLS) as address:
        yield address


@pytest.fixture(scope="module")
def notebook(lab, new_page):
    """The notebook with all cells run; it knows how long the stage took to appear."""
    page = new_page(1300, 1500)
    open_notebook(page, lab, len(CELLS))
    page.keyboard.press("Shift+Enter")
    until(page, "document.querySelector('.jp-OutputArea-executeResult') !== null", 30 * SLOW)
    page.wait_for_timeout(500)
    page.keyboard.press("Shift+Enter")
    begun = time.perf_counter()
    until(page, "document.querySelector('.jupyter-threejs canvas') && window.dancediff", 30 * SLOW)
    page.took = time.perf_counter() - begun
    page.keyboard.press("Escape")
    page.wait_for_timeout(1000 * SLOW)  # what the page tells of its new models is sent by then
    yield page
    page.close()


@pytest.fixture(autouse=True)
def _rest(notebook):
    """Every test finds the stage at rest in its first frame."""
    yield
    if notebook.evaluate("window.dancediff === undefined"):  # it was closed
        return
    if notebook.evaluate(f"{STATE}.playing"):
        press(notebook, "Pause")
    scrub(notebook, 0.0)
    press(notebook, "Orbit")


def press(page, button):
    page.locator(f"button:has-text('{button}')").first.click()
    page.wait_for_timeout(500)


def scrub(page, share):
    way = page.locator(".noUi-target").first.bounding_box()
    page.mouse.click(way["x"] + share * way["width"], way["y"] + way["height"] / 2)
    page.wait_for_timeout(300 * SLOW)


def picture(page):
    return chromium_page.picture(page, ".jupyter-threejs canvas")


def test_it_appears_soon(notebook):
    assert num_colors(picture(notebook)) > 200  # not blank
    assert notebook.took < 5 * SLOW


def test_it_plays_and_sends_nothing(notebook):
    still = picture(notebook)
    press(notebook, "Play")
    notebook.wait_for_timeout(1000)
    sent, before = len(notebook.sent), notebook.evaluate(STATE)
    notebook.wait_for_timeout(3000)
    after = notebook.evaluate(STATE)
    assert len(notebook.sent) == sent
    assert after["playing"] and after["frame"] - before["frame"] > 90 / SLOW
    assert 0.002 < changed(still, picture(notebook)) < 0.5


def test_dance_and_sound_are_in_step(notebook):
    press(notebook, "Play")
    notebook.wait_for_timeout(5000)
    late = notebook.evaluate(f"{STATE}.time - {STATE}.frame / 30")
    assert 0 <= late < 0.25 * SLOW  # the age of the picture: no drift can add up
    press(notebook, "Pause")
    state = notebook.evaluate(STATE)
    heard = notebook.evaluate("window.dancediff.audio().currentTime")
    assert notebook.evaluate("window.dancediff.audio().paused") and heard > 2
    assert abs(state["frame"] / 30 - heard) < 0.04
    clock = notebook.locator(".widget-html-content:has-text('frame')").inner_text()
    assert clock.endswith(f"frame {int(state['frame'] + 1e-3)}")


def test_slider_scrubs(notebook):
    still = picture(notebook)
    scrub(notebook, 0.5)
    assert notebook.evaluate(f"Math.abs({STATE}.frame - 449.5)") < 3
    assert 0.002 < changed(still, picture(notebook)) < 0.5


def test_strokes_stand_over_the_handle(notebook):
    scrub(notebook, 0.5)

    def centre(what):
        box = notebook.locator(what).bounding_box()
        return box["x"] + box["width"] / 2

    seconds = notebook.evaluate(f"{STATE}.time")
    zero, fifteen = centre(".noUi-target") - 374, centre("svg text:has-text('15 s')")
    assert abs(zero + 748 * seconds * 30 / 899 - centre(".noUi-handle")) < 1
    assert abs(zero + 748 * 15 * 30 / 899 - fifteen) < 1


def test_views_and_marks(notebook):
    scrub(notebook, 0.5)  # here all of them stand
    seen = [picture(notebook)]
    for view in ("Top view", "Follow"):
        press(notebook, view)
        notebook.wait_for_timeout(300 * SLOW)
        seen.append(picture(notebook))
        assert changed(seen[-1], seen[-2]) > 0.02
    for mark in ("Trails", "Feet on the floor"):
        before = picture(notebook)
        box = notebook.locator(f"label:has-text('{mark}') input")
        box.click()
        notebook.wait_for_timeout(300 * SLOW)
        assert 0 < changed(before, picture(notebook)) < 0.05
        box.click()


def to_the_end(page):
    """Play the last second and wait until the dance has begun again or stopped."""
    page.evaluate("window.dancediff.audio().currentTime = 29")
    until(page, f"{STATE}.frame < 200 || !{STATE}.playing", 20 * SLOW)


def test_it_begins_again_at_the_end_every_time(notebook):
    press(notebook, "Play")
    for _ in range(2):
        to_the_end(notebook)
        until(notebook, f"{STATE}.frame > 15 && {STATE}.frame < 300", 10 * SLOW)  # it goes on
        state = notebook.evaluate(STATE)
        assert state["playing"] and not notebook.evaluate("window.dancediff.audio().paused")


def test_a_sound_that_paused_itself_in_the_background_goes_on(notebook):
    press(notebook, "Play")
    notebook.evaluate("window.dancediff.audio().pause()")  # as browsers do to a hidden tab
    before = notebook.evaluate(f"{STATE}.frame")
    until(notebook, f"{STATE}.frame > {before} + 15", 10 * SLOW)


def test_without_loop_it_stops_at_the_end(notebook):
    loop = notebook.locator("label:has-text('loop') input")
    loop.click()
    press(notebook, "Play")
    to_the_end(notebook)
    state = notebook.evaluate(STATE)
    assert not state["playing"] and state["frame"] > 890
    loop.click()


def test_nothing_is_asked_of_another_host(notebook):
    hosts = {urlsplit(url).hostname for url in notebook.asked if url.startswith(("http", "ws"))}
    assert hosts == {"127.0.0.1"}


def test_nobody_complains(notebook):
    lab_itself = "Failed to load resource"  # settings that nobody has saved yet
    assert [text for text in notebook.complaints if lab_itself not in text] == []


def test_a_closed_stage_leaves_nothing_behind(notebook):
    """The last test, as the stage is gone then."""
    press(notebook, "Play")
    notebook.evaluate("window.heard = window.dancediff.audio()")
    notebook.locator(".jp-Notebook .jp-CodeCell").nth(2).click()
    notebook.keyboard.press("Shift+Enter")
    until(notebook, "window.dancediff === undefined", 30 * SLOW)
    assert notebook.evaluate("[window.heard.paused, window.heard.getAttribute('src')]") == [
        True,
        None,
    ]
    until(notebook, "document.querySelector('.jupyter-threejs, .noUi-target') === null", 30 * SLOW)
    test_nobody_complains(notebook)
