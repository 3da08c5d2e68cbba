"""The picture of a network says what runs in it, and leads to the lessons."""

import ast
import json
import re

import pytest
import torch

from dancediff.papers.lodge.global_diffusion import GlobalConfig
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.papers.lodge.model import Lodge, LodgeConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.viz.network_parts import LESSONS, LODGE, TCDIFFPP
from dancediff.viz.network_picture import network_picture
from dancediff.viz.network_trace import call_lodge, call_tcdiffpp, trace
from places import ROOT
from tiny_lodge import tiny_lodge
from tiny_tcdiffpp import tiny_tcdiffpp

SMALL = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
CASES = {
    "tcdiffpp": (lambda: tiny_tcdiffpp().model, TCDIFFPP, call_tcdiffpp),
    "lodge": (tiny_lodge, LODGE, call_lodge),
}


def plain_tcdiffpp(**sizes):
    return TCDiffPP(TCDiffPPConfig(**SMALL | {"fusion_hidden": 32} | sizes))


def box_at(layout, point):
    """The smallest box that a point lies on, if that is a part of the network."""
    x, y = point
    touched = [
        box
        for box in layout.boxes
        if not box.frame and box.x <= x <= box.x + box.width and box.y <= y <= box.y + box.height
    ]
    smallest = min(touched, key=lambda box: box.width * box.height, default=None)
    return smallest.module if smallest else ""


def given_to(network, call, target, source=None):
    """The tensors that a part gets, and once more with other numbers from another part."""
    seen, hooks = [], []

    def note(part, given):
        seen.append([v.clone() for v in given if isinstance(v, torch.Tensor)])

    def spoil(part, given, made):
        other = [
            v + 1 + torch.arange(v.shape[-1]) for v in (made if type(made) is tuple else [made])
        ]
        return tuple(other) if type(made) is tuple else other[0]

    hooks.append(network.get_submodule(target).register_forward_pre_hook(note))
    if source:
        hooks.append(network.get_submodule(source).register_forward_hook(spoil))
    with torch.no_grad():
        call(network)
    for hook in hooks:
        hook.remove()
    return seen[0]


@pytest.mark.parametrize("family", CASES)
def test_what_an_arrow_starts_from_reaches_where_it_ends(family):
    make, layout, call = CASES[family]
    network, tried = make(), 0
    for arrow in layout.arrows:
        source, target = (box_at(layout, arrow.points[end]) for end in (0, -1))
        if not source or not target:
            continue
        plain = given_to(network, call, target)
        spoiled = given_to(network, call, target, source)
        assert any(not torch.equal(a, b) for a, b in zip(plain, spoiled, strict=True)), arrow
        tried += 1
    assert tried >= 9


@pytest.mark.parametrize("family", CASES)
def test_parts_of_a_chain_stand_in_the_order_of_their_calls(family):
    make, layout, call = CASES[family]
    network = make()
    ended = list(trace(network, lambda: call(network)))
    for arrow in layout.arrows:
        source, target = (box_at(layout, arrow.points[end]) for end in (0, -1))
        if source and target:
            assert ended.index(source) < ended.index(target)


@pytest.mark.parametrize(("width", "frames"), [(16, 40), (24, 30)])
def test_shapes_are_those_of_the_network(width, frames):
    svg = network_picture(plain_tcdiffpp(d_model=width, num_frames=frames)).svg
    assert f"3×{frames}<" in svg and f"×{width}<" in svg
    assert f"memory tokens: {1 + frames + 2}×{width}<" in svg
    assert f"FiLM vector: {width}<" in svg


def test_layers_are_counted():
    assert "3 layers like this" in network_picture(plain_tcdiffpp(num_layers=3)).svg


def test_sizes_of_lodge_are_in_its_words():
    sizes = GlobalConfig(**SMALL, music_frames=96, local_frames=32, primitive_frames=4)
    plain = Lodge(LodgeConfig(sizes, LocalConfig(**SMALL, num_frames=32)))
    svg = network_picture(plain).svg
    assert "key motions of 3 s" in svg and "10 primitives" in svg and "of 4 frames" in svg


def test_a_part_that_is_not_there_has_neither_box_nor_arrow():
    sizes = GlobalConfig(**SMALL, music_frames=64, local_frames=64)
    plain = Lodge(LodgeConfig(sizes, LocalConfig(**SMALL, num_frames=64)))
    with_style, without = network_picture(tiny_lodge()).svg, network_picture(plain).svg
    assert with_style.count("style token") == 2 and without.count("style token") == 1
    assert with_style.count("<path d=") == without.count("<path d=") + 1


def test_only_what_is_asked_for_is_lit():
    model = tiny_tcdiffpp()
    dark, lit = network_picture(model).svg, network_picture(model, lit="swap_mode").svg
    changed = [b for a, b in zip(dark.split("\n"), lit.split("\n"), strict=True) if a != b]
    assert len(changed) == 4  # the box, two lines of words, and the lesson's number
    assert any("swap mode" in line for line in changed)
    both = network_picture(model, lit=("swap_mode", "decoder")).svg
    assert both.count('stroke-width="2.5"') > 5


def test_what_is_unknown_is_refused():
    with pytest.raises(ValueError, match=r"lit='feet' is no part; choose from .*footwork_adaptor"):
        network_picture(plain_tcdiffpp(), lit="feet")
    with pytest.raises(ValueError, match="model=3 has no picture; give a TCDiff"):
        network_picture(3)


@pytest.mark.parametrize("make", [plain_tcdiffpp, tiny_lodge])
def test_every_part_leads_to_a_lesson_that_is_there(make):
    picture = network_picture(make())
    links = re.findall(r'<a href="([^"]+)"', picture._repr_html_())
    assert len(links) == len(picture.weights)
    assert all((ROOT / "notebooks" / name).is_file() for name in links)


def test_links_lie_on_their_boxes():
    picture = network_picture(plain_tcdiffpp(), lit="swap_mode")
    link = re.search(r'<a href="09_[^>]*swap mode[^>]*>', picture._repr_html_())[0]
    left, top = (float(re.search(rf"{side}:([\d.]+)%", link)[1]) for side in ("left", "top"))
    rect = re.search(r'<rect x="(\d+)" y="(\d+)"[^>]*stroke-width="2.5"', picture.svg)
    assert left == pytest.approx(100 * int(rect[1]) / 700, abs=0.01)
    assert top == pytest.approx(100 * int(rect[2]) / picture.height, abs=0.01)


def test_a_network_is_left_as_it_was():
    network = plain_tcdiffpp(dropout=0.5).train()
    network.footwork_adaptor.eval()
    state = torch.get_rng_state()
    network_picture(network)
    assert torch.equal(state, torch.get_rng_state())
    assert network.training and not network.footwork_adaptor.training
    assert not any(m._forward_hooks or m._forward_pre_hooks for m in network.modules())


def test_the_picture_is_an_svg_file(tmp_path):
    from xml.etree import ElementTree

    path = network_picture(tiny_lodge()).save(tmp_path / "lodge.svg")
    root = ElementTree.parse(path).getroot()
    assert root.tag.endswith("svg") and root.get("viewBox").startswith("0 0 700 ")


def shown_in(lesson):
    """Where a lesson shows the picture, counted in cells, the parts lit, and what is stored."""
    path = next((ROOT / "notebooks").glob(f"{lesson:02d}_*.ipynb"))
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    found = [k for k, cell in enumerate(cells) if "network_picture(" in "".join(cell["source"])]
    assert len(found) == 1
    cell = cells[found[0]]
    call = ast.parse("".join(cell["source"])).body[-1].value
    lit = ast.literal_eval(next(word.value for word in call.keywords if word.arg == "lit"))
    html = "".join("".join(out["data"].get("text/html", "")) for out in cell["outputs"])
    return found[0], {lit} if isinstance(lit, str) else set(lit), html


@pytest.mark.parametrize("lesson", LESSONS)
def test_a_lesson_lights_its_own_part_near_its_start(lesson):
    position, lit, html = shown_in(lesson)
    layout = LODGE if lesson > 10 else TCDIFFPP
    assert position < 14
    assert [box for box in layout.boxes if box.key in lit and box.lesson == lesson]
    assert "data:image/svg+xml" in html and html.count("<a href=") > 10
