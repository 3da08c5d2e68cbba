import math

import numpy as np
import pytest
import scipy.linalg
import torch

from dancediff.metrics.fidelity import diversity, fid, frechet_distance, standardise, too_few


def normal(n, d=6, seed=0):
    g = torch.Generator().manual_seed(seed)
    mix = torch.randn(d, d, generator=torch.Generator().manual_seed(99), dtype=torch.float64)
    return torch.randn(n, d, generator=g, dtype=torch.float64) @ mix + 3


def slow_standardise(x, r):
    columns = []
    for k in range(x.shape[1]):
        mean = sum(r[:, k]) / len(r)
        deviation = math.sqrt(sum((value - mean) ** 2 for value in r[:, k]) / len(r))
        columns.append([(value - mean) / (deviation + 1e-10) for value in x[:, k]])
    return np.array(columns).T


def slow_covariance(x, mean):
    d = x.shape[1]
    return np.array([
        [sum((row[i] - mean[i]) * (row[j] - mean[j]) for row in x) / (len(x) - 1) for j in range(d)]
        for i in range(d)
    ])  # fmt: skip


def slow_fid(x, r):
    x, r = slow_standardise(x.numpy(), r.numpy()), slow_standardise(r.numpy(), r.numpy())
    means = [[sum(column) / len(s) for column in s.T] for s in (x, r)]
    S, Sr = (slow_covariance(s, mean) for s, mean in zip((x, r), means, strict=True))
    apart = sum((a - b) ** 2 for a, b in zip(*means, strict=True))
    return apart + np.trace(S + Sr - 2 * np.real(scipy.linalg.sqrtm(S @ Sr)))


def slow_diversity(x, r):
    x = slow_standardise(x.numpy(), r.numpy())
    n = len(x)
    total = sum(math.dist(x[i], x[j]) for i in range(n) for j in range(i + 1, n))
    return total / (n * (n - 1) / 2)


@pytest.mark.parametrize("compat", [None, "lodge", "aist", "gcd"])
def test_both_equal_the_slow_loop(compat):
    x, r = 1.3 * normal(15), normal(40, seed=1)
    assert fid(x, r, compat=compat) == pytest.approx(slow_fid(x, r), abs=1e-6)
    assert diversity(x, r, compat=compat) == pytest.approx(slow_diversity(x, r), abs=1e-6)


def test_a_set_is_at_distance_zero_from_itself():
    x = normal(200, d=72)
    assert fid(x, x) < 1e-6
    assert fid(x[:20], x[:20]) < 1e-6  # singular covariances
    assert fid(x[:20], x[:20] + 1) > 1


def test_two_halves_of_a_set_come_together_as_it_grows():
    values = []
    for n in (20, 200, 2000, 20000):
        x = normal(2 * n, d=16, seed=n)
        values.append(fid(x[:n], x[n:]))
    assert values == sorted(values, reverse=True)
    assert values[-1] < 0.01 < values[0]  # measured 5.6, 0.65, 0.071, 0.0045


def test_two_normal_distributions_have_their_known_distance():
    x = normal(300)
    # r has deviation s; x = 2 r + s: the mean is off by s + mean, the deviation doubled
    r = (x - x.mean(0)) / x.std(0, correction=0)
    n = len(r)
    spread = (2 - 1) ** 2 * 6 * n / (n - 1)  # unit variances, the factor for the covariance's n - 1
    assert fid(2 * r + 0.5, r) == pytest.approx(6 * 0.25 + spread, abs=1e-9)
    S = torch.diag(torch.tensor([4.0, 0.0]))
    T = torch.diag(torch.tensor([0.0, 9.0]))
    assert frechet_distance(torch.zeros(2), S, torch.zeros(2), T) == pytest.approx(13.0)


def test_the_order_of_the_samples_and_the_units_do_not_matter():
    x, r = normal(30), normal(50, seed=4)
    units = torch.tensor([1.0, 10, 0.1, 7, 1e3, 1e-3])
    for metric in (fid, diversity):
        assert metric(x.flip(0), r) == pytest.approx(metric(x, r), rel=1e-9)
        assert metric(x * units + 5, r * units + 5) == pytest.approx(metric(x, r), rel=1e-9)


def test_identical_samples_have_no_diversity_and_scatter_has_more():
    r = normal(50)
    assert diversity(r[:1].expand(8, -1), r) == 0.0
    mean = r.mean(0)
    assert diversity(mean + 2 * (r - mean), r) == pytest.approx(2 * diversity(r, r))


def test_few_samples_make_fid_too_large():
    r = normal(5000, d=32)
    few, many = (
        np.mean([fid(normal(n, 32, seed), r) for seed in range(10, 13)]) for n in (40, 640)
    )
    assert few > 5 * many


def test_what_the_reference_never_does_keeps_its_unit_unless_published():
    r, x = normal(30), normal(30, seed=2)
    r[:, 2], x[:, 2] = 0.0, 0.25
    assert standardise(x, r)[:, 2].tolist() == [0.25] * 30
    assert fid(x, r) < 10
    assert fid(x, r, compat="lodge") == pytest.approx((0.25e10) ** 2, rel=1e-6)


def test_too_small_sets_are_named():
    assert too_few(torch.zeros(73, 72)) is None
    assert "72 samples for 72 dimensions" in too_few(torch.zeros(72, 72))
    assert too_few(torch.zeros(5, 72), "reference").startswith("reference: 5 samples")


@pytest.mark.parametrize("metric", [fid, diversity])
def test_bad_input_is_named(metric):
    x, r = normal(10), normal(20)
    with pytest.raises(ValueError, match=r"features has 1 rows.*2"):
        metric(x[:1], r)
    with pytest.raises(ValueError, match=r"reference has 1 rows.*2"):
        metric(x, r[:1])
    with pytest.raises(ValueError, match=r"features has 5 columns, reference 6"):
        metric(x[:, :5], r)
    with pytest.raises(ValueError, match=r"features has shape \(10,\)"):
        metric(x[:, 0], r)
    with pytest.raises(ValueError, match=r"compat='edge'.*'lodge'"):
        metric(x, r, compat="edge")
    r[3, 2] = float("nan")
    with pytest.raises(ValueError, match=r"reference has NaN"):
        metric(x, r)
