"""Posture by genre: a window outside its own genre's range counts, and so does a growing metric."""

import sys

import numpy as np
import pytest

from dancediff.metrics.drift import Drift
from dancediff.metrics.posture import POSTURE
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
from posture_by_genre import rows_of


def of(*windows: float) -> Drift:
    """A dance whose metrics all have these values, window by window."""
    return Drift(np.tile(windows, (len(POSTURE), 1)), 5.0 * np.arange(len(windows)))


HELD = {"house": [of(*np.arange(101.0))], "jazz": [of(*(200 + np.arange(101.0)))]}


def test_dances_inside_their_genre_hold():
    row = rows_of({"house": [of(50, 60)], "jazz": [of(250, 260)]}, HELD)[0]
    assert (row.windows, row.means, row.holds) == (1.0, 1.0, True)
    assert (row.first, row.last) == (150, 160)


def test_each_genre_has_a_range_of_its_own():
    row = rows_of({"house": [of(50, 60)], "jazz": [of(50, 60)]}, HELD)[0]
    assert (row.windows, row.means, row.holds) == (0.5, 0.5, False)


def test_a_mean_may_be_inside_where_single_windows_are_not():
    row = rows_of({"house": [of(2, 50), of(98, 50)]}, HELD)[0]
    assert (row.windows, row.means) == (0.5, 1.0)


@pytest.mark.parametrize("ends", [(20, 90), (90, 20)])
def test_what_grows_or_fades_does_not_hold(ends):
    row = rows_of({"house": [of(*ends)]}, HELD)[0]
    assert row.means == 1 and (row.first, row.last) == ends and not row.holds


def test_what_never_happens_holds():
    row = rows_of({"house": [of(0, 0)]}, {"house": [of(0, 0, 0)]})[0]
    assert (row.first, row.last, row.holds) == (0, 0, True)


def test_a_genre_without_held_out_dances_is_named():
    with pytest.raises(ValueError, match="no held-out dance is krump"):
        rows_of({"krump": [of(1, 2)]}, HELD)
