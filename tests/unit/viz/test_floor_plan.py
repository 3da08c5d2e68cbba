"""The floor plan: what is dropped becomes a value, and the picture follows."""

import json
import re

import pytest

from dancediff.viz.floor_plan import FloorPlan, plan_svg
from dancediff.viz.palette import INK, PAPER

pytest.importorskip("ipywidgets")
pytest.importorskip("pythreejs")


def test_a_drop_is_a_new_value_and_a_new_picture():
    plan, seen = FloorPlan([(-1, 0), (1, 0.5)]), []
    plan.observe(lambda change: seen.append(plan.value))
    before = plan._picture.value
    plan._places.value = json.dumps([[-1, 0], [0.25, -0.5]])
    assert plan.value == ((-1.0, 0.0), (0.25, -0.5)) and seen == [plan.value]
    assert plan._picture.value != before


def test_reset_puts_the_discs_back():
    plan = FloorPlan([(-1, 0), (1, 0)])
    first = plan._picture.value
    plan.value = ((0.0, 0.0), (1.0, 1.0))
    plan.value = ((-1.0, 0.0), (1.0, 0.0))
    assert plan._picture.value == first


def test_places_are_where_they_are_drawn():
    """60 pixels a metre, the middle in the middle, the audience below."""
    svg = plan_svg(((-1.0, 0.5), (2.0, -1.0)), reach=2.5)
    assert 'transform="translate(90 180)"' in svg
    assert 'transform="translate(270 90)"' in svg
    assert re.findall(r">(\d)</text>", svg) == ["0", "1"]  # as swap= counts


def test_numbers_can_be_read_on_light_and_dark_discs():
    svg = plan_svg(((0.0, 0.0), (1.0, 0.0)), reach=2.5)
    assert re.findall(r'fill="(\S+)" font-weight="bold">(\d)', svg) == [(PAPER, "0"), (INK, "1")]


def test_the_script_knows_its_widgets():
    plan = FloorPlan([(0, 0)])
    assert plan._places.model_id in plan._script.func
    assert "this.widget_manager" in plan._script.func


@pytest.mark.parametrize(
    "places, match", [([], "0 entries"), ([(0, 0)] * 6, "6 entries"), ([(9, 0)], "within 2.5 m")]
)
def test_bad_places(places, match):
    with pytest.raises(ValueError, match=match):
        FloorPlan(places)
