"""Every metric answers to its own corruption, and no broken dance passes a results table."""

import importlib.util
import sys

import numpy as np
import pytest

from places import BENCHMARKS

# What each metric must notice at the least: (metric, corruption).
PAIRS = [
    ("fid_k", "jitter"),
    ("fid_g", "mean_pose"),
    ("div_k", "freeze"),
    ("div_k", "collapse"),
    ("div_g", "collapse"),
    ("gmr", "jitter"),
    ("gmc", "freeze"),
    ("tif", "overlap_dancers"),
    ("bas", "freeze"),
    ("bas", "shift_beats"),
    ("mmc", "shift_beats"),
    ("pfc", "drag_feet"),
    ("fsr", "drag_feet"),
    ("abrupt_swaps", "shuffle_time"),
    ("swap_obedience", "freeze"),
]
# Rows of a table on which a wholly broken dance fails clearly; here some of them. GMC halves in the
# mean pose, too, but groups that vary differ in it by as much.
CAUGHT = {
    "freeze": {"fid_k", "gmr", "gmc", "bas", "mmc"},
    "jitter": {"fid_k", "gmr", "fsr", "pfc", "mmc"},
    "mean_pose": {"fid_k", "fid_g", "gmr", "div_k", "pfc", "fsr"},
}
SEEDS, GROUPS, REFERENCE = 5, 4, 80


@pytest.fixture(scope="module")
def bench():
    path = BENCHMARKS / "metric_response.py"
    spec = importlib.util.spec_from_file_location("metric_response", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.fixture(scope="module")
def reference(bench):
    return bench.make_sample(bench.REFERENCE_SEED, REFERENCE)


@pytest.fixture(scope="module")
def samples(bench):
    return [bench.make_sample(seed, GROUPS) for seed in range(SEEDS)]


def test_the_table_names_every_metric(bench):
    assert {metric for metric, _ in PAIRS} == set(bench.METRICS)
    for metric, corruption in PAIRS:
        assert corruption in bench.METRICS[metric].moved_by


@pytest.mark.parametrize(("metric", "corruption"), PAIRS)
def test_more_damage_is_a_worse_score(metric, corruption, bench, samples, reference):
    v = bench.respond(corruption, [metric], samples, reference)[metric]
    worse = -bench.METRICS[metric].better * np.diff(v.mean(1))
    assert (worse >= 0).all(), v.mean(1)
    assert (worse > 0).sum() >= 3, v.mean(1)
    assert (bench.METRICS[metric].better * (v[-1] - v[0]) < 0).all(), v[[0, -1]]  # in every seed


@pytest.fixture(scope="module")
def wholly(bench, samples, reference):
    """Every metric's values (2, seeds): good, and wholly broken."""
    return {
        name: bench.respond(name, bench.METRICS, samples, reference, levels=(0.0, 1.0))
        for name in CAUGHT
    }


@pytest.mark.parametrize("name", CAUGHT)
def test_a_broken_dance_fails_clearly(name, bench, wholly):
    failed = {metric for metric, v in wholly[name].items() if bench.fails(metric, *v)}
    assert len(CAUGHT[name]) >= 2
    assert CAUGHT[name] <= failed


def test_other_good_dances_fail_nowhere(bench, wholly, reference):
    fresh = [bench.make_sample(seed, GROUPS) for seed in range(50, 50 + SEEDS)]
    for metric, spec in bench.METRICS.items():
        values = np.array([spec.measure(sample, reference) for sample in fresh])
        assert not bench.fails(metric, wholly["freeze"][metric][0], values), metric


def test_what_is_known_to_be_blind_is_blind(bench, wholly):
    """So that the documents' warnings stay true."""
    good, frozen = wholly["freeze"]["pfc"]
    assert frozen.max() == 0 < good.min()  # the best PFC there is
    good, frozen = wholly["freeze"]["fsr"]
    assert (frozen <= good).all()
    good, shaken = wholly["jitter"]["gmc"]
    assert shaken.min() > 3 * good.max()
