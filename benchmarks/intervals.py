"""A mean and its 95 % bootstrap interval, as tables have them."""

from collections.abc import Sequence

import numpy as np

from dancediff.metrics.bootstrap import bootstrap_interval

Interval = list[float | None]


def mean_with_interval(values: Sequence[float] | np.ndarray, form: str = "") -> Interval:
    """Mean, low and high end, rounded to ``form``; one value has no interval, and none no mean.

    >>> mean_with_interval([1.0, 2.0, 3.0, 4.0])[0], mean_with_interval([2 / 3], ".2f")
    (2.5, [0.67, None, None])
    """
    found = np.asarray(values, dtype=float)
    if len(found) == 0:
        return [None, None, None]
    if len(found) == 1:
        return [float(f"{found[0]:{form}}"), None, None]
    three = (float(found.mean()), *bootstrap_interval(np.mean, found))
    return [float(f"{value:{form}}") for value in three]


def in_words(value: float | None, low: float | None, high: float | None, form: str = ".4g") -> str:
    """What is known of them.

    >>> in_words(2.5, 1.75, 3.25), in_words(2.5, None, None), in_words(None, None, None)
    ('2.5 [1.75, 3.25]', '2.5', '')
    """
    if value is None:
        return ""
    return f"{value:{form}}" + ("" if low is None else f" [{low:{form}}, {high:{form}}]")
