"""The tables and the picture of docs/how_a_dance_is_made.md, from the registry and the presets.

`tables.py` writes them; a page asks for the table of a family with ``<!-- made: FAMILY -->``.
"""

import re
import textwrap
from pathlib import Path
from xml.sax.saxutils import escape

from dancediff.extensions.registry import REGISTRY, Extension
from dancediff.generation.presets import PACKAGED, PAPER

SOURCE = Path(__file__).parents[2] / "src" / "dancediff"
PICTURE = Path(__file__).parents[1] / "images" / "how_a_dance_is_made.svg"
MADE = re.compile(r"(<!-- made: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

WHERE = {
    "training": "Weights, before any dance",
    "network": "Network: noise and music to a guess",
    "guidance": "Guidance of each guess",
    "hook": "Hooks on each guess",
    "sampling": "Steps and segments",
}
PAPERS = {  # where the paper's part of it is
    "tcdiffpp": {
        "training": ("papers/tcdiffpp/losses.py",),
        "network": ("papers/tcdiffpp/model.py",),
        "guidance": ("diffusion/guidance.py",),
        "hook": (),
        "sampling": ("papers/tcdiffpp/long_group_sampling.py", "diffusion/ddim.py"),
    },
    "lodge": {
        "training": ("papers/lodge/losses.py",),
        "network": ("papers/lodge/model.py",),
        "guidance": ("diffusion/guidance.py",),
        "hook": (),
        "sampling": ("papers/lodge/parallel.py", "papers/lodge/cue_guidance.py"),
    },
}
KIND_OF = {  # options of presets that are no extension
    "genre": "network",
    "energy": "network",
    "guidance": "guidance",
    "foot_contact": "hook",
    "sampler": "sampling",
    "steps": "sampling",
    "eta": "sampling",
    "sigma_min": "sampling",
    "pinning": "sampling",
    "seam": "sampling",
    "soft": "sampling",
}


def heard(option: str, family: str) -> bool:
    """Whether the packaged model of a family can hear an option; all can but genre and energy.

    >>> heard("energy", "tcdiffpp"), heard("energy", "lodge"), heard("steps", "lodge")
    (True, True, True)
    """
    condition = REGISTRY.get(f"{option}_condition")
    return condition is None or condition.packaged_in(family)


def options(presets: dict, family: str, kind: str) -> str:
    """What the preset of a family says there, but for extensions.

    >>> options(PACKAGED, "tcdiffpp", "guidance")
    '`guidance=1.0`'
    """
    return ", ".join(
        f"`{name}={value!r}`"
        for name, value in presets[family].items()
        if name not in REGISTRY and KIND_OF[name] == kind and heard(name, family)
    )


def switch(preset: dict, name: str, on: bool) -> str:
    """How an extension stands in a preset.

    >>> switch(PACKAGED["lodge"], "autoguidance", True), switch(PAPER["lodge"], "ssd", False)
    ('`autoguidance=1.2`', 'off')
    """
    return f"`{name}={preset[name]!r}`" if name in preset else "on" if on else "off"


def table_of(family: str) -> str:
    """Both presets of a family, step by step."""
    lines = ["| | `paper` | `packaged` | in one line |", "| --- | --- | --- | --- |"]
    for kind, files in PAPERS[family].items():
        there = [e for e in REGISTRY.values() if e.kind == kind and family in e.models]
        cells = [options(presets, family, kind) for presets in (PAPER, PACKAGED)]
        links = ", ".join(f"[{Path(file).stem}](../src/dancediff/{file})" for file in files)
        as_in = f"As the paper or its code has it: {links}." if links else "The paper has none."
        lines.append(f"| **{WHERE[kind]}** | {cells[0]} | {cells[1]} | {as_in} |")
        for number, one in enumerate((e for e in there if e.packaged_in(family)), 1):
            name = f"{number}. " * (kind == "hook") + f"[{one.name}]({source(one)})"
            theirs = switch(PAPER[family], one.name, False)
            ours = switch(PACKAGED[family], one.name, True)
            lesson = f" Lesson {one.lesson:02d}." if one.lesson is not None else ""
            lines.append(f"| {name} | {theirs} | {ours} | {one.summary}{lesson} |")
    return "\n".join([*lines, ""])


def source(extension: Extension) -> str:
    """The file that holds an extension, seen from docs/."""
    dotted = extension.module if "." in extension.module else f"extensions.{extension.module}"
    return f"../src/dancediff/{dotted.replace('.', '/')}.py"


def written(text: str) -> str:
    """A page with the tables that it asks for."""
    return MADE.sub(lambda m: f"{m[1]}\n{table_of(m[2])}\n{m[3]}", text)


WIDTH, LEFT, BOX, TEXT, LINE = 900, 90, 314, 420, 18
STAGES = (  # title, what the papers do there, kinds of extensions
    ("Music", "35 features a frame, 30 frames a second", ()),
    ("Noise", "random numbers in the shape of a segment", ()),
    ("Network", "noise, music, and an order or a style: a guess of the clean dance",
     ("network", "training")),
    ("Guidance", "away from the guess without music; cut to what the training set has",
     ("guidance",)),
    ("Hooks on the guess", "the papers have none", ("hook",)),
    ("Step", "a little less noise; known frames and Lodge's cues are pasted in", ("step",)),
    ("Segments", "TCDiff++: the next begins with the end of this one. Lodge: all at once, from cue"
     " to cue", ("sampling",)),
    ("Dance", "places and joint rotations of everybody", ()),
)  # fmt: skip
STEP = ("dpm_solver",)  # of kind sampling, in every step


def names(kinds: tuple[str, ...]) -> list[str]:
    """Packaged extensions that act in a stage of the picture."""
    return [
        e.name
        for e in REGISTRY.values()
        if any(map(e.packaged_in, PAPERS)) and ("step" if e.name in STEP else e.kind) in kinds
    ]


def picture() -> str:
    """The data's way as SVG: what the papers do in boxes, what we add beside them."""
    parts, y, at = [], 20, {}
    for title, says, kinds in STAGES:
        inside = textwrap.wrap(says, 42)
        beside = textwrap.wrap(", ".join(names(kinds)), 64, break_on_hyphens=False)
        height = max(26 + LINE * len(inside), 8 + LINE * len(beside)) + 10
        at[title] = (y, y + height)
        parts.append(
            f'<rect x="{LEFT}" y="{y}" width="{BOX}" height="{height}" rx="6" class="box"/>'
        )
        parts.append(text(LEFT + 12, y + 22, title, "title"))
        parts += [text(LEFT + 12, y + 42 + LINE * k, line) for k, line in enumerate(inside)]
        parts += [text(TEXT, y + 22 + LINE * k, line, "ours") for k, line in enumerate(beside)]
        y += height + 24
    middle = LEFT + BOX / 2
    for _, (_, end), (start, _) in zip(STAGES, at.values(), list(at.values())[1:], strict=False):
        parts.append(arrow(f"M{middle:g} {end} V{start - 3}"))
    for first, last, x, says in (
        ("Network", "Step", 60, "every step"),
        ("Noise", "Segments", 28, "every segment of TCDiff++"),
    ):
        top, bottom = (sum(at[name]) / 2 for name in (first, last))
        parts.append(arrow(f"M{LEFT} {bottom:g} H{x} V{top:g} H{LEFT - 4}"))
        where = f"translate({x - 6} {(top + bottom) / 2:g}) rotate(-90)"
        parts.append(f'<text transform="{where}" text-anchor="middle">{says}</text>')
    return FRAME.format(width=WIDTH, height=y, inside="\n".join(parts))


def text(x: int, y: int, words: str, kind: str = "papers") -> str:
    """A line of text."""
    return f'<text x="{x}" y="{y}" class="{kind}">{escape(words)}</text>'


def arrow(path: str) -> str:
    """A line with a head at its end."""
    return f'<path d="{path}" class="way" marker-end="url(#head)"/>'


FRAME = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img">
<title>From a song to a dance</title>
<style>
text {{ font: 13px sans-serif; fill: #333 }}
.title {{ font-weight: bold; font-size: 15px }}
.ours {{ fill: #0a58a8 }}
.box {{ fill: #f3f3f3; stroke: #888 }}
.way {{ fill: none; stroke: #555; stroke-width: 1.5 }}
</style>
<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8"
orient="auto"><path d="M0 0 L8 4 L0 8 z" fill="#555"/></marker></defs>
<rect width="100%" height="100%" fill="white"/>
{inside}
</svg>
"""
