"""What was asked of a dance holds in the packaged model's dances, and nobody jumps to it.

Bars: 5 cm and 5 degrees; no root jump of 12 cm. How much more feet slide takes more dances than a
test has time for: benchmarks/control_bars.py measures it, docs/control.md has the numbers.
"""

import runpy
from functools import cache, partial

import pytest

import dancediff as dd
from places import BENCHMARKS

pytestmark = pytest.mark.slow

BENCHMARK = BENCHMARKS / "control_bars.py"
SEEDS = 2


@cache
def bars():
    return runpy.run_path(str(BENCHMARK))


@cache
def dances():
    """How to dance, free dances, and others to keep parts of."""
    generate = dd.load("tcdiffpp").generate
    dance_with = partial(generate, dd.packaged_song(), dancers=3, seconds=5, steps=25)
    free, others = ([dance_with(seed=k + first) for k in range(SEEDS)] for first in (0, 1000))
    return dance_with, free, others


@pytest.mark.parametrize(
    "kind",
    ["start", "end", "path of one dancer", "in between", "upper body", "one dancer"],
)
def test_it_holds_and_nobody_jumps(kind):
    found = bars()["row"](*dances(), kind)
    assert max(found["cm"]) < 5 and max(found["degrees"]) < 5
    assert max(found["jump"]) < 12
