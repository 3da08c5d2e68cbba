"""The floor plan's script with a real mouse: what is dropped is sent, and nothing else is.

The plan stands in a page of its own, and models of ours in the place of a notebook's.
"""

import json

import pytest

from dancediff.viz.floor_plan import plan_svg
from dancediff.viz.in_page import FOLDER

PLACES = ((-1.234, 0.0), (1.0, 0.517))
MODELS = """([script, places, reach]) => {
  const view = { el: document.body };
  const picture = { views: { one: Promise.resolve(view) }, once: (_, end) => (window.end = end) };
  window.sent = [];
  const model = {
    value: JSON.stringify(places),
    get() { return this.value; },
    set(_, value) { this.value = value; },
    save_changes() { window.sent.push(JSON.parse(this.value)); },
  };
  const models = { picture, places: model };
  const manager = { has_model: (id) => id in models, get_model: async (id) => models[id] };
  const facts = { models: { picture: "picture", places: "places" }, pixels: 60, reach };
  return (0, eval)(script)(manager, facts);
}"""


@pytest.fixture
def plan(page):
    """Opens a plan, whose corner is that of the page."""

    def show(reach=2.5):
        page.set_content(f"<body style='margin:0'>{plan_svg(PLACES, reach)}</body>")
        script = (FOLDER / "floor_plan.js").read_text(encoding="utf-8").strip()
        page.evaluate(MODELS, [script, json.loads(json.dumps(PLACES)), reach])
        return page

    return show


def take(page, dancer, reach=2.5, **options):
    x, z = PLACES[dancer]
    page.mouse.move((reach + x) * 60, (reach + z) * 60)
    page.mouse.down(**options)
    page.wait_for_timeout(50)


def move(page, x, z, reach=2.5):
    page.mouse.move((reach + x) * 60, (reach + z) * 60, steps=5)


def where(page, dancer):
    return page.locator(f"[data-dancer='{dancer}']").get_attribute("transform")


def sent(page):
    return page.evaluate("window.sent")


def test_who_is_dragged_moves_and_nobody_else(plan):
    page = plan()
    take(page, 1)
    move(page, -0.5, -1.0)
    page.mouse.up()
    assert sent(page) == [[[-1.234, 0.0], [-0.5, -1.0]]]
    move(page, 1.0, 1.0)  # it was let go
    assert len(sent(page)) == 1 and where(page, 1).startswith("translate(120 ")


def test_a_click_moves_nobody(plan):
    page = plan()
    take(page, 0)
    page.mouse.up()
    assert sent(page) == []


def test_the_right_button_takes_nobody(plan):
    page = plan()
    before = where(page, 0)
    take(page, 0, button="right")
    move(page, 1.0, 1.0)
    page.mouse.up(button="right")
    assert where(page, 0) == before and sent(page) == []


def test_a_drag_that_is_cut_off_ends(plan):
    page = plan()
    take(page, 0)
    move(page, 0.0, 1.0)
    page.evaluate("document.dispatchEvent(new PointerEvent('pointercancel'))")
    after = where(page, 0)
    move(page, 2.0, -2.0)
    assert where(page, 0) == after and len(sent(page)) == 1
    page.mouse.up()
    assert len(sent(page)) == 1


def test_nobody_is_dropped_beside_a_floor_of_any_size(plan):
    page = plan(reach=2.33)
    take(page, 1, reach=2.33)
    move(page, 5.0, -5.0, reach=2.33)
    page.mouse.up()
    assert sent(page) == [[[-1.234, 0.0], [2.3, -2.3]]]


def test_a_closed_plan_listens_no_more(plan):
    page = plan()
    page.evaluate("window.end()")
    take(page, 0)
    move(page, 0.0, 1.0)
    page.mouse.up()
    assert sent(page) == []
