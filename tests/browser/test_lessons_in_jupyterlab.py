"""Lessons in a real JupyterLab: run all, move every control to both ends, look at what changes.

The server listens on 127.0.0.1 only. A run of these takes minutes, most of them for dancing.
"""

from pathlib import Path

import pytest
from chromium_page import SLOW, changed, num_colors, serve_lab, shot, until

pytest.importorskip("jupyterlab")
pytest.importorskip("pythreejs")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
BOOKS = Path(__file__).parents[2] / "notebooks"
LESSONS = ("00_tour", "06_the_sampling_lab", "12_fill_in_the_rest")
BOOK = "window.jupyterapp.shell.currentWidget.content"
CODE = f"{BOOK}.widgets.map((w, i) => [w.model, i]).filter(([m]) => m.type === 'code')"
OUTPUTS = "Array.from({length: m.outputs.length}, (_, k) => m.outputs.get(k))"
UNMOVED = ("mirrored cues", "cues on beats")  # a dance may have no cue that they change


@pytest.fixture(scope="module", params=LESSONS)
def lesson(request, chromium, new_page, tmp_path_factory):
    """A lesson after "Run All", on its panel."""
    with serve_lab(tmp_path_factory.mktemp("lab"), BOOKS / f"{request.param}.ipynb") as address:
        page = new_page(1300, 1700)
        page.name = request.param
        page.goto(f"{address}/lab/tree/test.ipynb?reset")
        until(page, "document.body.innerText.includes('| Idle')", 60 * SLOW)
        page.evaluate("void window.jupyterapp.commands.execute('notebook:run-all-cells')")
        until(page, f"{CODE}.every(([m]) => m.executionCount !== null)", 100 * SLOW)
        yield page
        page.close()


def scroll_to(page, text):
    """Bring the output of the cell with this code into view."""
    where = f"{CODE}.find(([m]) => m.sharedModel.source.includes('{text}'))[1]"
    page.evaluate(f"{BOOK}.activeCellIndex = {where}")
    page.evaluate(f"void {BOOK}.scrollToItem({where}, 'start')")
    page.wait_for_timeout(500 * SLOW)


def panel_of(page):
    """The controls, the picture and the buttons of the lesson's panel."""
    scroll_to(page, "panels.explore(")
    return page.locator(".jp-OutputArea-output:has(button:has-text('Pin as A'))").last


def wait_for_picture(page, panel, before, must_change=True):
    picture, bar = panel.locator("img.widget-image").first, panel.locator(".widget-hprogress")
    for _ in range(round(1200 * SLOW)):
        page.wait_for_timeout(100)
        if must_change and picture.get_attribute("src") == before:
            continue
        if not bar.is_visible():
            break
    error = panel.locator("pre:has-text('Error')")
    assert error.count() == 0, error.first.inner_text()
    return picture.get_attribute("src")


def ends(page, panel):
    """Every control, last one first, as (its name, functions that move it to its two ends)."""
    found = []
    for box in panel.locator(".widget-inline-hbox:has(.noUi-target)").all():
        way = box.locator(".noUi-target")

        def click(share, way=way):
            at = way.bounding_box()
            way.click(position={"x": share * (at["width"] - 2) + 1, "y": at["height"] / 2})

        name = box.locator(".widget-label").first.inner_text()
        found.append((box, name, [lambda c=click: c(1.0), lambda c=click: c(0.0)]))
    for box in panel.locator(".widget-dropdown").all():
        choice, name = box.locator("select"), box.locator(".widget-label").first.inner_text()
        last = choice.locator("option").count() - 1
        moves = [lambda c=choice, k=k: c.select_option(index=k) for k in (last, 0)]
        found.append((box, name, moves))
    found.sort(key=lambda part: part[0].bounding_box()["y"])
    return [(name, moves) for _, name, moves in reversed(found)]


def test_no_cell_fails(lesson):
    failed = lesson.evaluate(
        f"{CODE}.flatMap(([m]) => {OUTPUTS}.filter((o) => o.type === 'error'))"
        ".map((o) => o.toJSON().evalue)"
    )
    assert failed == []


def test_a_dance_is_seen_on_the_stage(lesson):
    if lesson.name != "00_tour":
        pytest.skip("this lesson has no stage")
    scroll_to(lesson, "dd.play(")
    canvas = lesson.locator(".jupyter-threejs canvas").first
    canvas.wait_for(timeout=60_000 * SLOW)
    lesson.wait_for_timeout(1000 * SLOW)
    still = shot(canvas)
    assert num_colors(still) > 200
    lesson.locator("button:has-text('▶ Play')").first.click()
    lesson.wait_for_timeout(1500 * SLOW)
    lesson.locator("button:has-text('❚❚ Pause')").first.click()
    lesson.wait_for_timeout(300 * SLOW)
    played = shot(canvas)
    assert changed(still, played) > 0.002
    slider = lesson.locator(".noUi-target").first
    at = slider.bounding_box()
    slider.click(position={"x": 0.9 * at["width"], "y": at["height"] / 2})
    lesson.wait_for_timeout(500 * SLOW)
    assert changed(played, shot(canvas)) > 0.002


def test_every_control_goes_to_both_ends(lesson):
    panel = panel_of(lesson)
    panel.locator("button:has-text('Dance')").first.click()
    seen = wait_for_picture(lesson, panel, "")
    assert seen
    controls = ends(lesson, panel)
    assert len(controls) >= 3
    for name, moves in controls:
        pictures = []
        for move in moves:
            move()
            seen = wait_for_picture(lesson, panel, seen, must_change=name not in UNMOVED)
            pictures.append(seen)
        assert name in UNMOVED or pictures[0] != pictures[1], name


def test_nobody_complains(lesson):
    lab_itself = ("lumino", "Failed to load resource")
    said = [text for text in lesson.complaints if not any(part in text for part in lab_itself)]
    assert said == []
