"""benchmarks/speed.py: what it compares with takes the place of what the library does."""

import sys

from dancediff.extensions import ssd
from dancediff.generation import guided_denoiser
from dancediff.nn import ssm
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
import speed


def test_the_naive_way_takes_the_place_of_ours_and_leaves_it():
    places = ((ssd, "ssd_scan"), (ssm, "selective_scan"), (guided_denoiser, "guided"))
    ours = [getattr(module, name) for module, name in places]
    with speed.naive():
        assert all(getattr(m, n) is not one for (m, n), one in zip(places, ours, strict=True))
    assert [getattr(module, name) for module, name in places] == ours
