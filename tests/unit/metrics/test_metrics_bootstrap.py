import numpy as np
import pytest
import torch

from dancediff.metrics.bootstrap import bootstrap_interval
from dancediff.metrics.fidelity import fid


def sets(count, n, d, seed, shift=0.0):
    rng = np.random.default_rng(seed)
    return [torch.as_tensor(rng.normal(shift, 1, (n, d))) for _ in range(count)]


def covered(statistic, samples, truth, draws=200, level=0.95):
    """In how many of the sets of samples the interval holds the truth, as a share."""
    hits = 0
    for seed, x in enumerate(samples):
        low, high = bootstrap_interval(statistic, x, draws=draws, seed=seed, level=level)
        hits += low <= truth <= high
    return hits / len(samples)


@pytest.mark.parametrize(("level", "least", "most"), [(0.95, 0.89, 0.99), (0.5, 0.40, 0.60)])
def test_the_interval_of_a_mean_holds_the_truth_as_often_as_it_says(level, least, most):
    rng = np.random.default_rng(3)
    samples = rng.normal(2.0, 3.0, (400, 30))
    assert least < covered(np.mean, samples, 2.0, level=level) < most


def test_the_interval_of_fid_holds_its_mean_at_that_size_which_the_plain_one_misses():
    reference = sets(1, 300, 8, 7)[0]

    def statistic(x):
        return fid(x, reference)

    truth = np.mean([statistic(x) for x in sets(300, 60, 8, 8, shift=0.3)])
    samples = sets(60, 60, 8, 9, shift=0.3)
    assert 0.9 < covered(statistic, samples, truth, draws=60)
    plain = 0
    for seed, x in enumerate(samples):
        rows = np.random.default_rng(seed).integers(0, 60, (60, 60))
        low, high = np.quantile([statistic(x[row]) for row in rows], (0.025, 0.975))
        plain += low <= truth <= high
    assert plain / 60 < 0.8


def test_with_fewer_samples_than_dimensions_the_number_still_lies_in_its_interval():
    reference, x = sets(1, 200, 32, 1)[0], sets(1, 20, 32, 2)[0]
    low, high = bootstrap_interval(lambda s: fid(s, reference), x, draws=50)
    assert low < fid(x, reference) < high


def test_of_a_mean_it_is_the_percentile_interval_of_balanced_draws():
    x = np.random.default_rng(0).exponential(size=25)
    means = []

    def statistic(s):
        means.append(s.mean())
        return means[-1]

    low, high = bootstrap_interval(statistic, x, draws=80)
    assert np.mean(means[1:]) == pytest.approx(x.mean(), abs=1e-12)
    assert (low, high) == pytest.approx(tuple(np.quantile(means[1:], (0.025, 0.975))))


def test_of_a_biased_statistic_both_ends_move_by_the_bias():
    x = np.random.default_rng(0).exponential(size=25)
    values = []

    def statistic(s):
        values.append(s.var())
        return values[-1]

    ends = bootstrap_interval(statistic, x, draws=80)
    bias = np.mean(values[1:]) - values[0]
    assert bias < -0.01
    assert ends == pytest.approx(tuple(np.quantile(values[1:], (0.025, 0.975)) - bias))


def test_a_share_stays_between_its_limits():
    for ones in (0, 1, 9, 10):
        x = np.array([1.0] * ones + [0.0] * (10 - ones))
        low, high = bootstrap_interval(np.mean, x)
        assert 0 <= low <= ones / 10 <= high <= 1
    assert bootstrap_interval(np.mean, np.full(7, 0.3)) == pytest.approx((0.3, 0.3))


def test_more_samples_and_a_lower_level_narrow_it():
    x = np.random.default_rng(1).normal(size=1600)
    few, many = (np.diff(bootstrap_interval(np.mean, x[:n]))[0] for n in (100, 1600))
    assert 2.8 < few / many < 5.6  # 4 in expectation
    assert np.diff(bootstrap_interval(np.mean, x, level=0.5)) < 0.6 * many


def test_the_seed_decides():
    x = np.random.default_rng(1).normal(size=20)
    assert bootstrap_interval(np.mean, x, seed=1) == bootstrap_interval(np.mean, x, seed=1)
    assert bootstrap_interval(np.mean, x, seed=1) != bootstrap_interval(np.mean, x, seed=2)


def test_samples_arrive_in_their_own_container():
    kinds = []

    def statistic(s):
        kinds.append(type(s))
        return float(sum(float(v) for v in s))

    values = [1.0, 2.0, 4.0]
    results = {
        bootstrap_interval(statistic, kind(values), draws=5)
        for kind in (list, np.array, torch.tensor)
    }
    assert len(results) == 1
    assert set(kinds) == {list, np.ndarray, torch.Tensor}


def test_undefined_draws_are_left_out_up_to_half():
    def of_positive(s):
        return float(np.mean(s[s > 0])) if (s > 0).any() else float("nan")

    low, high = bootstrap_interval(of_positive, np.array([-1.0, -1, 2, 4]))  # 1 draw in 16 has none
    assert (low, high) == (pytest.approx(2, abs=0.2), pytest.approx(4, abs=0.2))
    with pytest.raises(ValueError, match=r"statistic is 2\.0 of all.*finite in \d+ of 200"):
        bootstrap_interval(
            lambda s: 2.0 if (np.sort(s) == np.arange(9)).all() else np.nan, np.arange(9.0)
        )
    with pytest.raises(ValueError, match="statistic is nan"):
        bootstrap_interval(lambda s: float("nan"), np.arange(9.0))


def test_bad_input_is_named():
    with pytest.raises(ValueError, match=r"samples has 1 entries.*2"):
        bootstrap_interval(np.mean, np.ones(1))
    with pytest.raises(ValueError, match=r"level=95.*0\.95"):
        bootstrap_interval(np.mean, np.ones(3), level=95)
    with pytest.raises(ValueError, match="draws=1"):
        bootstrap_interval(np.mean, np.ones(3), draws=1)
