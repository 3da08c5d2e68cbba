"""Lessons in a real JupyterLab: run all, move every control to both ends, look at what changes.

The server listens on 127.0.0.1 only. A run of these takes minutes, most of them for dancing.
"""

from functools import partial

import pytest
from chromium_page import SLOW, changed, num_colors, serve_lab, shot, until

from places import BOOKS

pytest.importorskip("jupyterlab")
pytest.importorskip("pythreejs")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
LESSONS = ("00_tour", "06_the_sampling_lab", "12_fill_in_the_rest")
BOOK = "window.jupyterapp.shell.currentWidget.content"
CODE = f"{BOOK}.widgets.map((w, i) => [w.model, i]).filter(([m]) => m.type === 'code')"
OUTPUTS = "Array.from({length: m.outputs.length}, (_, k) => m.outputs.get(k))"
STATE = "window.dancediff.state()"
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
    if not must_change:
        page.wait_for_timeout(1000 * SLOW)
    for _ in range(round(300 * SLOW)):
        page.wait_for_timeout(100)
        changed_yet = not must_change or picture.get_attribute("src") != before
        if changed_yet and not bar.is_visible():
            break
    else:
        raise AssertionError("the panel is not done, or shows the same picture")
    error = panel.locator("pre:has-text('Error')")
    assert error.count() == 0, error.first.inner_text()
    return picture.get_attribute("src")


def wait_for_change(page, canvas, before):
    """A page that has just come draws late, when its machine is busy."""
    for _ in range(round(15 * SLOW)):
        page.wait_for_timeout(500)
        if changed(before, shot(canvas)) > 0.002:
            return
    raise AssertionError("the stage shows the same picture as before")


def ends(panel):
    """Every control, last one first: its name, functions that move it to its ends.

    They say whether there was anything to move.
    """

    def drag(way, share):
        handle = way.locator(".noUi-handle")
        at, low, high = (
            float(handle.get_attribute(f"aria-value{k}")) for k in ("now", "min", "max")
        )
        if at == (high if share else low):
            return False
        box = way.bounding_box()
        way.click(position={"x": share * (box["width"] - 2) + 1, "y": box["height"] / 2})
        return True

    def choose(choice, index):
        if choice.evaluate("it => it.selectedIndex") == index:
            return False
        choice.select_option(index=index)
        return True

    found = []
    for box in panel.locator(".widget-inline-hbox:has(.noUi-target)").all():
        moves = [partial(drag, box.locator(".noUi-target"), share) for share in (1.0, 0.0)]
        found.append((box, moves))
    for box in panel.locator(".widget-dropdown").all():
        choice = box.locator("select")
        last = choice.locator("option").count() - 1
        found.append((box, [partial(choose, choice, index) for index in (last, 0)]))
    found.sort(key=lambda part: part[0].bounding_box()["y"], reverse=True)
    return [(box.locator(".widget-label").first.inner_text(), moves) for box, moves in found]


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
    wait_for_change(lesson, canvas, still)
    lesson.locator("button:has-text('❚❚ Pause')").first.click()
    lesson.wait_for_timeout(500 * SLOW)
    played = shot(canvas)
    lesson.wait_for_timeout(1000)
    assert changed(played, shot(canvas)) < 0.002
    # a loop may have been stopped anywhere: the slider goes to the side that is farther off
    frames = 150
    share = 0.1 if lesson.evaluate(f"{STATE}.frame") > frames / 2 else 0.9
    slider = lesson.locator(".noUi-target").first
    at = slider.bounding_box()
    slider.click(position={"x": share * at["width"], "y": at["height"] / 2})
    until(lesson, f"Math.abs({STATE}.frame - {share * frames}) < 5", 15 * SLOW)
    wait_for_change(lesson, canvas, played)


def test_one_stage_plays_at_a_time(lesson):
    if lesson.name != "00_tour":
        pytest.skip("this lesson has no two stages")
    for cell in ("dd.play(dance", "dd.play(model.generate(mine"):
        lesson.evaluate("window.before = window.dancediff")
        scroll_to(lesson, cell)
        play = lesson.locator(f".jp-Cell:has-text('{cell}') button:has-text('▶ Play')")
        play.first.click(timeout=60_000 * SLOW)
        until(lesson, f"{STATE}.playing", 15 * SLOW)
    until(lesson, "window.before !== window.dancediff && !window.before.state().playing")
    lesson.evaluate("window.dancediff.pause()")


def test_every_control_goes_to_both_ends(lesson):
    panel = panel_of(lesson)
    panel.locator("button:has-text('Dance')").first.click()
    seen = wait_for_picture(lesson, panel, "")
    assert seen
    controls = ends(panel)
    assert len(controls) >= 3
    for name, moves in controls:
        for move in moves:
            if move():
                seen = wait_for_picture(lesson, panel, seen, must_change=name not in UNMOVED)
