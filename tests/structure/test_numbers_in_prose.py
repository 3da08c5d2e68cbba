"""Where prose says a number of the code, it is the number of the code.

Each line: a page, what it says (one group of a regular expression; any white space between words),
and where the number is in the code: a dotted name, with keys of dicts and fields of dataclasses.
"""

import dataclasses
import json
import math
import re
from importlib import import_module

import pytest

from places import ROOT

PACKAGED = "dancediff.generation.presets.PACKAGED"
PAPER = "dancediff.generation.presets.PAPER"
TRAIN = "dancediff.training.config.TrainConfig"
WEIGHTS = "dancediff.papers.tcdiffpp.losses.LossWeights"
SWAPS, RHYTHM = "dancediff.metrics.swaps", "dancediff.metrics.rhythm"
SAID = [
    ("notebooks/00_tour.ipynb", r"out of pure noise, in (\d+) steps", f"{PACKAGED}.tcdiffpp.steps"),
    (
        "notebooks/01_*.ipynb",
        r"under (\d+) cm for an ankle",
        "dancediff.motion.contact.CONTACT_HEIGHT.0",
    ),
    ("notebooks/01_*.ipynb", r"(\d+) cm for a toe", "dancediff.motion.contact.CONTACT_HEIGHT.2"),
    (
        "notebooks/01_*.ipynb",
        r"less than (\d+) cm a frame",
        "dancediff.motion.contact.CONTACT_SPEED",
    ),
    ("notebooks/05_*.ipynb", r"([\d.]+)\\,L_\{simple\}", f"{WEIGHTS}.simple"),
    ("notebooks/05_*.ipynb", r"([\d.]+)\\,L_\{vel\}", f"{WEIGHTS}.vel"),
    ("notebooks/05_*.ipynb", r"([\d.]+)\\,L_\{FK\}", f"{WEIGHTS}.fk"),
    ("notebooks/05_*.ipynb", r"([\d.]+)\\,L_\{contact\}", f"{WEIGHTS}.contact"),
    ("notebooks/05_*.ipynb", r"([\d.]+)\\,L_\{dis\}", f"{WEIGHTS}.dist"),
    (
        "notebooks/06_*.ipynb",
        r"moves the root ([\d.]+) times",
        "dancediff.extensions.autoguidance.ROOT_SHARE",
    ),
    (
        "notebooks/06_*.ipynb",
        r"The papers' code takes (\d+); `generate`",
        f"{PAPER}.tcdiffpp.guidance",
    ),
    ("notebooks/06_*.ipynb", r"`generate` takes (\d+)", f"{PACKAGED}.tcdiffpp.guidance"),
    ("notebooks/12_*.ipynb", r"of its (\d+) steps", f"{PACKAGED}.lodge.steps"),
    ("notebooks/16_*.ipynb", r"guidance \(the papers' code: (\d+)\)", f"{PAPER}.tcdiffpp.guidance"),
    ("README.md", r"(\d+) in all, with", "dancediff.exercises.EXERCISES"),
    ("docs/teaching.md", r"(\d+) exercises that check", "dancediff.exercises.EXERCISES"),
    ("docs/results_tcdiffpp.md", r"(\d+) steps,\s+autoguidance", f"{PACKAGED}.tcdiffpp.steps"),
    (
        "docs/results_tcdiffpp.md",
        r"autoguidance ([\d.]+), and rules",
        f"{PACKAGED}.tcdiffpp.autoguidance",
    ),
    (
        "docs/results_tcdiffpp.md",
        r"keeps ankles (\d+) cm apart",
        "dancediff.extensions.foot_contact_projection.APART",
    ),
    ("docs/results_lodge.md", r"Defaults: (\d+) steps", f"{PACKAGED}.lodge.steps"),
    ("docs/results_lodge.md", r"guidance (\d+), autoguidance", f"{PACKAGED}.lodge.guidance"),
    ("docs/results_lodge.md", r"autoguidance ([\d.]+), soft", f"{PACKAGED}.lodge.autoguidance"),
    ("docs/results_lodge.md", r"soft cues for ([\d.]+) of the way", f"{PACKAGED}.lodge.soft"),
    ("docs/drift.md", r"The default became ([\d.]+)", f"{PACKAGED}.tcdiffpp.autoguidance"),
    ("docs/performance.md", r"\| (\d+) steps of DPM-Solver", f"{PACKAGED}.tcdiffpp.steps"),
    ("docs/performance.md", r"instead of (\d+) of DDIM", f"{PAPER}.tcdiffpp.steps"),
    ("docs/control.md", r"`slack` \(([\d.]+) m\)", "dancediff.extensions.control.WalkAlong.slack"),
    (
        "docs/why_nobody_swapped.md",
        r"in order, (\d+) cm apart",
        "dancediff.extensions.order_constraint.GAP",
    ),
    (
        "docs/differences.md",
        r"Limits come first: turns of (\d+) degrees",
        "dancediff.extensions.speed_limit.ROOT_LIMIT",
    ),
    (
        "docs/differences.md",
        r"\(root\) or (\d+) \(joints\)",
        "dancediff.extensions.speed_limit.JOINT_LIMIT",
    ),
    (
        "docs/differences.md",
        r"steps of ([\d.]+) m/s",
        "dancediff.extensions.speed_limit.TRAVEL_LIMIT",
    ),
    (
        "docs/differences.md",
        r"ankles (\d+) cm apart",
        "dancediff.extensions.foot_contact_projection.APART",
    ),
    ("docs/differences.md", r"cut at (four) standard", "dancediff.extensions.frequency_clip.LIMIT"),
    (
        "docs/differences.md",
        r"`overlap`, default (\d+) \|",
        "dancediff.generation.request.TCDiffPPRequest.overlap",
    ),
    (
        "docs/differences.md",
        r"is then (\d+) beats late",
        "dancediff.extensions.group_relations.CANON_BEATS",
    ),
    ("docs/metrics_swaps.md", r"faster than ([\d.]+) m/s", f"{SWAPS}.JUMP_SPEED"),
    ("docs/metrics_rhythm.md", r"σ = ([\d.]+) s", f"{RHYTHM}.SIGMA"),
    ("docs/metrics_rhythm.md", r"smoothed over ([\d.]+) s", f"{RHYTHM}.SMOOTH"),
    (
        "docs/metrics_feet.md",
        r"`threshold`, ([\d.]+) m/s",
        "dancediff.metrics.physical.SLIDE_SPEED",
    ),
    ("docs/metrics_feet.md", r"ankle under (\d+) cm", "dancediff.motion.contact.CONTACT_HEIGHT.0"),
    ("docs/metrics_collision.md", r"closer than ([\d.]+) m on", "dancediff.metrics.collision.DISC"),
    ("docs/metrics_group.md", r"log\(1 \+ ([\d.]+) E\)", "dancediff.metrics.group.GAIN"),
    ("docs/metrics_report.md", r"more than ([\d,]+) vectors", "dancediff.metrics.rows.MOST"),
    ("docs/metrics_report.md", r"over ([\d,]+) frames", "dancediff.metrics.measure.LONGEST_GMC"),
    (
        "docs/metrics_posture.md",
        r"wrists more than (\d+) m apart",
        "dancediff.metrics.posture.WIDE",
    ),
    ("docs/metrics_posture.md", r"ankles closer than (\d+) cm", "dancediff.metrics.posture.CLOSE"),
    ("docs/metrics_posture.md", r"below ([\d.]+) m/s", "dancediff.metrics.posture.STILL"),
    ("docs/metrics_posture.md", r"more than (\d+) cm a joint", "dancediff.metrics.posture.APART"),
    ("docs/metrics_posture.md", r"stay within (\d+) cm", "dancediff.metrics.posture.STANDS"),
    ("docs/metrics_posture.md", r"cm for (\d+) s", "dancediff.metrics.posture.STAND"),
    ("docs/metrics_posture.md", r"if it has (\d+) windows", "dancediff.metrics.rows.LEAST_WINDOWS"),
    ("docs/metrics_posture.md", r"kept for (\d+) s", "dancediff.metrics.formation.LASTS"),
    ("docs/metrics_posture.md", r"(\d+) cm a dancer", "dancediff.metrics.formation.OTHER"),
    ("docs/metrics_posture.md", r"by more than (\d+) cm", "dancediff.metrics.formation.PASSED"),
    ("docs/conventions.md", r"ankle under ([\d.]+) m", "dancediff.motion.contact.CONTACT_HEIGHT.0"),
    ("docs/conventions.md", r"hop (\d+);", "dancediff.music.features.HOP"),
    ("docs/conventions.md", r"(\d+) frames a second", "dancediff.music.features.FPS"),
    ("docs/cluster.md", r"every `save_every` steps \((\d+)\)", f"{TRAIN}.save_every"),
    (
        "docs/your_own.md",
        r"needs takes of ([\d,]+) frames",
        "dancediff.papers.lodge.primitives.Layout.global_frames",
    ),
]
WORDS = {"four": 4}


def value(name: str):
    """What a dotted name stands for.

    >>> value("math.pi"), value("dancediff.motion.contact.CONTACT_HEIGHT.0")
    (3.141592653589793, 0.12)
    """
    parts = name.split(".")
    for k in range(len(parts) - 1, 0, -1):
        try:
            found = import_module(".".join(parts[:k]))
            break
        except ImportError:
            continue
    for part in parts[k:]:
        if isinstance(found, dict):
            found = found[part]
        elif part.isdigit():
            found = found[int(part)]
        elif dataclasses.is_dataclass(found):
            found = next(f.default for f in dataclasses.fields(found) if f.name == part)
        else:
            found = getattr(found, part)
    return found if isinstance(found, int | float) else len(found)


def text_of(page: str) -> str:
    """The page, or the Markdown of a lesson, on one line."""
    path = next(ROOT.glob(page))
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        text = "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
    return " ".join(text.split())


@pytest.mark.parametrize(("page", "words", "name"), SAID, ids=[f"{p}:{n}" for p, _, n in SAID])
def test_prose_says_the_number_of_the_code(page, words, name):
    found = re.search(words, text_of(page))
    assert found, f"{page} no longer says {words!r}"
    said = WORDS.get(found[1]) or float(found[1].replace(",", ""))
    true = value(name)
    scales = (1, 100, 180 / math.pi)  # as it is, in cm, in degrees
    assert any(math.isclose(said, true * s, rel_tol=1e-6) for s in scales), (said, true)
