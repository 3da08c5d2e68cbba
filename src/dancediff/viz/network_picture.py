"""The whole network in one picture: its parts, what runs between them, the lessons about them.

Read first: `dancediff.viz.network_parts`, where the boxes stand · `dancediff.viz.network_trace`,
which runs the network and notes the shapes.
"""

import base64
import math
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from pathlib import Path

from torch import nn

from dancediff.atomic import write_text
from dancediff.axes import FPS
from dancediff.papers.lodge.model import Lodge
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.viz.network_parts import LESSONS, LODGE, TCDIFFPP, Arrow, Box, Diagram
from dancediff.viz.network_trace import Call, call_lodge, call_tcdiffpp, trace
from dancediff.viz.palette import GRID, INK, MUTED, PAPER, dancer_color

WIDTH = 700
SHOWN = 940  # pixels in a notebook that has as many: letters are as large as those around
LIT, LIGHT = dancer_color(0), "#DCEBF6"  # of what is lit: its border and its ground
GROUND = "#F2F4F7"  # of what is not
FONT = "Helvetica, Arial, 'Liberation Sans', sans-serif"


@dataclass(frozen=True)
class NetworkPicture:
    """A picture that a notebook shows; a click on a part opens its lesson.

    ``svg`` is the picture alone, and `save` writes it to a file.
    """

    svg: str
    about: str
    height: float
    weights: dict[Box, int]  # of every box; 0 where there is no part of the network

    def save(self, path) -> Path:
        """Write the picture as an SVG file; returns its path."""
        path = Path(path)
        write_text(path, self.svg)
        return path

    def __repr__(self) -> str:
        return f"<picture of {self.about}>"

    def _repr_html_(self) -> str:
        """The picture as an image, which a notebook shows unasked; links lie above it."""
        code = base64.b64encode(self.svg.encode()).decode()
        links = "".join(self._link(box) for box in self.weights)
        return (
            f'<div style="position:relative;max-width:{SHOWN}px">'
            f'<img alt="{escape(self.about)}" style="width:100%;display:block" '
            f'src="data:image/svg+xml;base64,{code}">{links}</div>'
        )

    def _link(self, box: Box) -> str:
        """An empty link over a box; over a frame it covers the line of words only."""
        name = LESSONS[box.lesson]
        height = 22 if box.frame else box.height
        at = {
            "left": box.x / WIDTH,
            "top": box.y / self.height,
            "width": box.width / WIDTH,
            "height": height / self.height,
        }
        style = ";".join(f"{side}:{100 * share:.2f}%" for side, share in at.items())
        count = f", {self.weights[box]:,} weights" if self.weights[box] else ""
        words = escape(f"{' '.join(box.words.split())}{count}: lesson {box.lesson:02d}")
        return (
            f'<a href="{name}.ipynb" title="{words}" aria-label="{words}" '
            f'style="position:absolute;{style}"></a>'
        )


def network_picture(model, *, lit=()) -> NetworkPicture:
    """Draw a network: its parts, the shapes of what runs between them, and the lessons about them.

    ``model``: a TCDiff++ or a Lodge, as `dancediff.load` gives it or as a module; or "tcdiffpp" or
    "lodge" for the network of the paper, in its sizes. It is called once, on zeros, and every shape
    in the picture is one that was seen in that call.
    ``lit``: the part, or parts, to point out, such as "fusion_projection".

    Shapes in the picture leave out the batch: dancers x frames x channels, or tokens x channels.
    Raises: ValueError for a model that has no picture, and for a part that is not in it.

    >>> tiny = TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=32)
    >>> picture = network_picture(TCDiffPP(tiny), lit="fusion_projection")
    >>> picture
    <picture of TCDiff++: from a noisy group and its music to a clean guess>
    >>> "3×150" in picture.svg
    True
    """
    network = _network(model)
    layout = LODGE if isinstance(network, Lodge) else TCDIFFPP
    if isinstance(network, Lodge):
        calls = trace(network, partial(call_lodge, network))
    else:
        calls = trace(network, partial(call_tcdiffpp, network))
    sizes = _sizes(network)
    boxes = tuple(
        replace(box, words=box.words.format(**sizes))
        for box in layout.boxes
        if not box.module or box.module in calls
    )
    lit = (lit,) if isinstance(lit, str) else tuple(lit)
    _check(lit, boxes)
    shown = [_box(box, _is_lit(box, lit), network) for box in boxes]
    arrows = [_arrow(arrow, calls) for arrow in layout.arrows if _runs(arrow, calls)]
    words = [_text(w.text, w.x, w.y, 10, INK) for w in layout.words]
    frames = sum(box.frame for box in boxes)
    parts = [*shown[:frames], *arrows, *shown[frames:], *words]
    weights = {box: calls[box.module].weights if box.module else 0 for box in boxes}
    return NetworkPicture(_svg(layout, parts), layout.about, layout.height, weights)


def _network(model) -> TCDiffPP | Lodge:
    """The module to draw."""
    if model == "tcdiffpp":
        return TCDiffPP(TCDiffPPConfig.paper())
    if model == "lodge":
        return Lodge()
    network = model if isinstance(model, nn.Module) else getattr(model, "model", None)
    if not isinstance(network, TCDiffPP | Lodge):
        raise ValueError(
            f"model={model!r} has no picture; give a TCDiff++ or a Lodge, 'tcdiffpp' or 'lodge'"
        )
    return network


def _sizes(network: TCDiffPP | Lodge) -> dict[str, float]:
    """What words in boxes may ask for."""
    if isinstance(network, TCDiffPP):
        return {}
    c = network.config.global_stage
    frames, seconds = c.primitive_frames, c.music_frames / FPS
    return {"seconds": seconds, "primitives": c.layout.num_primitives, "frames": frames}


def _names(box: Box) -> set[str]:
    """What `lit` may call a box: its key, and the parts of the network that it lies in."""
    return {box.key, *box.module.split(".")} - {"", "0", "layers"}


def _is_lit(box: Box, lit: tuple[str, ...]) -> bool:
    return bool(_names(box) & set(lit))


def _check(lit: tuple[str, ...], boxes: tuple[Box, ...]) -> None:
    known = set().union(*map(_names, boxes))
    for name in lit:
        if name not in known:
            raise ValueError(f"lit={name!r} is no part; choose from {', '.join(sorted(known))}")


def _runs(arrow: Arrow, calls: dict[str, Call]) -> bool:
    return {arrow.module, arrow.needs} - {""} <= calls.keys()


def _svg(layout: Diagram, parts: list[str]) -> str:
    size = f'viewBox="0 0 {WIDTH} {layout.height:g}" width="{WIDTH}" height="{layout.height:g}"'
    tip = (
        f'<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="6" '
        f'markerHeight="6" orient="auto"><path d="M0,0 L8,4 L0,8 z" fill="{MUTED}"/></marker>'
        "</defs>"
    )
    ground = f'<rect width="{WIDTH}" height="{layout.height:g}" rx="8" fill="{PAPER}"/>'
    inside = "\n".join([f"<title>{escape(layout.about)}</title>", tip, ground, *parts])
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="{FONT}">\n{inside}\n</svg>'


def _text(text: str, x: float, y: float, size: float, color: str, more: str = "") -> str:
    return (
        f'<text x="{x:g}" y="{y:g}" font-size="{size:g}" fill="{color}" '
        f'text-anchor="middle"{more}>{escape(text)}</text>'
    )


def _box(box: Box, lit: bool, network: nn.Module) -> str:
    """A box with its words and the number of its lesson."""
    holds = box.frame or box.words in ("Sequence Decoder", "decoder layers")
    line = f'stroke="{LIT if lit else GRID}" stroke-width="{2.5 if lit else 1}"'
    if box.frame:
        line += ' stroke-dasharray="5 4" fill="none"'
    else:
        line += f' fill="{LIGHT if lit else GROUND if not holds else PAPER}"'
    shape = (
        f'<rect x="{box.x:g}" y="{box.y:g}" width="{box.width:g}" height="{box.height:g}" '
        f'rx="5" {line}/>'
    )
    lines = box.words.split("\n")
    if box.words in ("Sequence Decoder", "decoder layers"):
        lines.append(f"{_num_layers(box, network)} layers like this:")
        lines[0] = lines[0].replace("decoder layers", "decoder")
    bold = ' font-weight="bold"' if lit else ""
    middle = box.x + box.width / 2
    first = box.y + 14 if holds else box.y + box.height / 2 + 3.5 - 5.5 * (len(lines) - 1)
    words = [_text(one, middle, first + 11 * k, 9.5, INK, bold) for k, one in enumerate(lines)]
    return "\n".join([shape, *words, _lesson(box, lit)])


def _num_layers(box: Box, network: nn.Module) -> int:
    """How many layers the stack has that a box stands for."""
    stack = network.get_submodule(box.module.removesuffix(".layers.0") + ".layers")
    return len(list(stack.children()))


def _lesson(box: Box, lit: bool) -> str:
    """The number of the lesson, on the upper right corner; the blocks of a layer are too small."""
    if ".layers.0." in box.module:
        return ""
    inside = 12 if box.frame else 0
    x, y = box.x + box.width - 3 - inside, box.y + 1 + inside
    ground = LIT if lit else MUTED
    return (
        f'<rect x="{x - 8:g}" y="{y - 7:g}" width="16" height="12" rx="3" fill="{ground}"/>'
        + _text(f"{box.lesson:02d}", x, y + 2.5, 8, PAPER, ' font-weight="bold"')
    )


def _arrow(arrow: Arrow, calls: dict[str, Call]) -> str:
    path = " L".join(f"{x:g},{y:g}" for x, y in arrow.points)
    line = f'<path d="M{path}" fill="none" stroke="{MUTED}" marker-end="url(#tip)"/>'
    if not arrow.module:
        return line
    shape = getattr(calls[arrow.module], arrow.side)[arrow.index]
    (x, y), (x2, y2) = arrow.points[:2]
    if arrow.label or x == x2:  # an upright arrow has it at its side
        at = arrow.label or (x + 22, (y + y2) / 2 + 3)
        return line + _text(arrow.words + "×".join(map(str, shape)), *at, 8.5, MUTED)
    half = math.ceil(len(shape) / 2)
    above, below = shape[:half], shape[half:]
    middle = (x + x2) / 2 - 2
    lines = [_text("×".join(map(str, above)), middle, y - 4, 8.5, MUTED)]
    if below:
        lines.append(_text("×" + "×".join(map(str, below)), middle, y + 12, 8.5, MUTED))
    return line + "".join(lines)
