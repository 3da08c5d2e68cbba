"""A floor plan to drag dancers on: a control for `dancediff.viz.panels.explore`."""

import json

from dancediff.viz.in_page import in_page
from dancediff.viz.palette import FLOOR, GRID, INK, MUTED, dancer_color, ink_on

_PIXELS = 60  # a metre on the screen

Places = tuple[tuple[float, float], ...]


class FloorPlan:
    """Dancers seen from above; ``value`` is a place (x, z) in metres for each of them.

    Drag a disc with the mouse. A drop is one message to the kernel, dragging is none. x grows to
    the right, z towards the audience, who sits below; ``reach`` metres from the middle are shown.
    ``box`` is the widget; `value` and `observe` are as those of a widget.

    Raises: ValueError for a place that is not on the plan, or more than five.

    >>> plan = FloorPlan([(-1, 0), (1, 0)])
    >>> plan.value
    ((-1.0, 0.0), (1.0, 0.0))
    """

    def __init__(self, places, *, reach: float = 2.5, label: str = "start"):
        import ipywidgets as widgets
        import pythreejs

        self.reach = reach
        self._picture, self._places = widgets.HTML(), widgets.Text()
        facts = {
            "models": {"picture": self._picture.model_id, "places": self._places.model_id},
            "pixels": _PIXELS,
            "reach": reach,
        }
        self._script = in_page(pythreejs, "floor_plan.js", facts)  # alive as long as the plan
        self.observe(self._draw)
        self.value = places
        self.box = widgets.VBox([widgets.Label(f"{label}: drag the dancers"), self._picture])

    @property
    def value(self) -> Places:
        """A place for each dancer."""
        return _checked(json.loads(self._places.value), self.reach)

    @value.setter
    def value(self, places) -> None:
        self._places.value = json.dumps(_checked(places, self.reach))

    def observe(self, handler, names="value") -> None:
        """Call ``handler`` after every drop."""
        self._places.observe(handler, names=names)

    def unobserve(self, handler, names="value") -> None:
        """Call it no longer."""
        self._places.unobserve(handler, names=names)

    def _draw(self, _) -> None:
        self._picture.value = plan_svg(self.value, self.reach)


def plan_svg(places: Places, reach: float) -> str:
    """The plan as SVG; one group a dancer, which the script moves.

    >>> plan_svg(((0.0, 0.0),), 1.0).count("data-dancer")
    1
    """
    side = 2 * reach * _PIXELS
    lines = [k * _PIXELS + side / 2 for k in range(-int(reach), int(reach) + 1)]
    grid = "".join(
        f'<path d="M{at} 0V{side}M0 {at}H{side}" stroke="{GRID}" stroke-width="0.7"/>'
        for at in lines
    )
    discs = "".join(
        f'<g data-dancer="{k}" transform="translate({side / 2 + x * _PIXELS:g} '
        f'{side / 2 + z * _PIXELS:g})" style="cursor:grab">'
        f'<circle r="15" fill="{dancer_color(k)}"/>'
        f'<text y="5" text-anchor="middle" fill="{ink_on(dancer_color(k))}" font-weight="bold">'
        f"{k}</text></g>"
        for k, (x, z) in enumerate(places)
    )
    words = (
        f'<text x="{side / 2}" y="{side - 6}" text-anchor="middle" fill="{MUTED}">audience</text>'
    )
    style = f"background:{FLOOR};touch-action:none;user-select:none;font:13px sans-serif;fill:{INK}"
    return f'<svg width="{side:g}" height="{side:g}" style="{style}">{grid}{words}{discs}</svg>'


def _checked(places, reach: float) -> Places:
    """Places as a tuple, on the plan."""
    pairs = tuple((float(x), float(z)) for x, z in places)
    if not 1 <= len(pairs) <= 5:
        raise ValueError(f"places has {len(pairs)} entries; 1 to 5 dancers can be placed")
    if any(abs(c) > reach for pair in pairs for c in pair):
        raise ValueError(f"places={pairs} must lie within {reach} m of the middle")
    return pairs
