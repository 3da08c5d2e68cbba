"""Win rates: closed forms, and how often the interval holds what is true."""

import math

import numpy as np
import pytest
import torch

from dancediff.metrics.preference import effective_votes, wilson_interval, win_rate


def test_wilsons_interval_where_all_votes_are_alike():
    z2 = 1.959963984540054**2
    assert wilson_interval(1.0, 10) == pytest.approx((10 / (10 + z2), 1.0))
    assert wilson_interval(0.0, 10) == pytest.approx((0.0, z2 / (10 + z2)))


@pytest.mark.parametrize(("p", "n"), [(0.0, 5), (0.3, 7), (0.5, 20), (1.0, 3)])
def test_its_ends_are_z_standard_errors_from_p(p, n):
    """What the formula solves: |p - q| = z sqrt(q (1 - q) / n), with q an end."""
    for q in wilson_interval(p, n):
        assert abs(p - q) == pytest.approx(1.959963984540054 * math.sqrt(q * (1 - q) / n), abs=1e-9)


def test_votes_of_one_pair_are_worth_one_when_they_are_always_alike():
    pairs = np.repeat(np.arange(8), 20)
    wins = np.repeat([1, 1, 1, 1, 1, 1, 0, 0], 20)
    assert effective_votes(wins, pairs) == pytest.approx(7)  # G - 1
    assert effective_votes(np.ones(160), pairs) == 8
    assert math.isnan(effective_votes(wins, np.zeros(160)))


def test_independent_votes_are_worth_about_their_number():
    rng = np.random.default_rng(1)
    wins = rng.random((400, 25)) < 0.6
    worth = effective_votes(wins.ravel(), np.repeat(np.arange(400), 25))
    assert 0.8 * 10_000 < worth <= 10_000


@pytest.mark.parametrize("axis", [0, 1])
def test_one_unanimous_rater_or_pair_is_one_vote(axis):
    one, many = ["x"] * 6, list("abcdef")
    pairs, raters = (one, many) if axis else (many, one)
    rate = win_rate([1] * 6, pairs, raters)
    assert rate[:3] == (1.0, *wilson_interval(1.0, 6)) and rate.effective == 6
    assert win_rate([1], ["a"], ["x"]).effective == 1


def test_both_groupings_count():
    """Three pairs and four raters of one mind: 1/3 + 1/4 - 1/12."""
    pairs, raters = np.repeat(np.arange(3), 4), np.tile(np.arange(4), 3)
    assert win_rate(np.ones(12), pairs, raters).effective == pytest.approx(2)


def test_the_interval_holds_the_true_rate_as_often_as_it_says():
    """Taste differs from pair to pair and from rater to rater; 95 % is meant."""
    rng, held, naive = np.random.default_rng(2), [], []
    pairs, raters = np.repeat(np.arange(16), 12), np.tile(np.arange(12), 16)
    for _ in range(400):
        pair, rater = rng.normal(0, 0.6, 16), rng.normal(0, 0.6, 12)
        wins = 0.4 + pair[pairs] + rater[raters] + rng.normal(size=192) > 0
        rate = win_rate(wins, pairs, raters)
        low, high = wilson_interval(rate.value, 192)
        # the sum of the four is normal with variance 1 + 2 · 0.36
        true = 0.5 * (1 + math.erf(0.4 / math.sqrt(2 * 1.72)))
        held.append(rate.low <= true <= rate.high)
        naive.append(low <= true <= high)
    assert 0.9 < np.mean(held) < 0.98 and np.mean(naive) < 0.7


def test_lists_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="1 wins, 2 pairs, 1 raters"):
        win_rate([1], ["a", "b"], ["x"])
    with pytest.raises(ValueError, match="at least one vote"):
        win_rate([], [], [])
    with pytest.raises(ValueError, match="wins has 2; give 1 for a win"):
        win_rate([1, 2], ["a", "b"], ["x", "y"])
    with pytest.raises(ValueError, match=r"p=1\.5"):
        wilson_interval(1.5, 3)


def test_votes_may_be_a_tensor_and_ties_are_halves():
    votes, by = [1.0, 0.5, 0.0], (list("abc"), list("xyx"))
    assert win_rate(torch.tensor(votes), *by) == win_rate(votes, *by)
