"""benchmarks/intervals.py: a mean with its interval, also of one value and of none."""

import sys

import numpy as np

from dancediff.metrics.bootstrap import bootstrap_interval
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
from intervals import in_words, mean_with_interval


def test_the_mean_stands_before_the_interval_of_the_metrics():
    values = np.random.default_rng(0).normal(size=20)
    assert mean_with_interval(values) == [values.mean(), *bootstrap_interval(np.mean, values)]
    assert mean_with_interval([*values], ".1f")[0] == round(values.mean(), 1)


def test_one_value_has_no_interval_and_no_value_no_mean():
    assert in_words(*mean_with_interval([2.0])) == "2"
    assert in_words(*mean_with_interval([])) == ""
    assert in_words(*mean_with_interval([0.0, 1.0]), ".1f").startswith("0.5 [")
