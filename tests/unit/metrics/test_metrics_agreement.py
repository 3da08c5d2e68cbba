"""Krippendorff's alpha against Fleiss' kappa, whose worked example is in his paper."""

import math

import numpy as np
import pytest

from dancediff.metrics.agreement import krippendorff_alpha

FLEISS = np.array(  # 10 subjects, 14 raters, 5 categories: kappa is 0.210
    [
        *([0, 0, 0, 0, 14], [0, 2, 6, 4, 2], [0, 0, 3, 5, 6], [0, 3, 9, 2, 0], [2, 2, 8, 1, 1]),
        *([7, 7, 0, 0, 0], [3, 2, 6, 3, 0], [2, 5, 3, 2, 2], [6, 5, 2, 1, 0], [0, 2, 2, 3, 7]),
    ]
)


def kappa(counts: np.ndarray) -> float:
    """Fleiss' kappa, written down as he does."""
    items, raters = len(counts), counts[0].sum()
    agree = ((counts**2).sum(1) - raters) / (raters * (raters - 1))
    chance = ((counts.sum(0) / (items * raters)) ** 2).sum()
    return (agree.mean() - chance) / (1 - chance)


def test_it_is_kappa_but_for_a_factor():
    assert kappa(FLEISS) == pytest.approx(0.210, abs=5e-4)
    n = FLEISS.sum()
    expected = 1 - (1 - kappa(FLEISS)) * (n - 1) / n
    assert krippendorff_alpha(FLEISS) == pytest.approx(expected)


def test_raters_who_agree_and_raters_who_never_do():
    assert krippendorff_alpha([[5, 0], [0, 5], [3, 0]]) == 1  # also with votes missing
    # one vote each way on both items: D_o = 1, D_e = 2 · 2 · 2 / (4 · 3)
    assert krippendorff_alpha([[1, 1], [1, 1]]) == pytest.approx(1 - 1 / (8 / 12))


def test_votes_at_random_give_nothing():
    rng = np.random.default_rng(0)
    left = rng.binomial(20, 0.5, 2000)
    assert abs(krippendorff_alpha(np.stack([left, 20 - left], 1))) < 0.01


def test_an_item_with_one_vote_does_not_count():
    assert krippendorff_alpha([[2, 1], [0, 3], [1, 0]]) == krippendorff_alpha([[2, 1], [0, 3]])


@pytest.mark.parametrize("counts", [[[1, 0], [0, 1]], [[4, 0], [4, 0]]])
def test_where_it_is_not_defined_it_is_nan(counts):
    assert math.isnan(krippendorff_alpha(counts))


@pytest.mark.parametrize("counts", [[1, 2], [[0.5, 1]], [[-1, 2]]])
def test_what_are_no_counts_is_refused(counts):
    with pytest.raises(ValueError, match="table"):
        krippendorff_alpha(counts)
