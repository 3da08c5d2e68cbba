r"""Whether raters agree more often than by chance.

Read first: `dancediff.metrics.preference`, which says what they prefer.

Symbols (axes: N items · K choices)
    counts  how many raters made each choice for each item   (N, K)
    n_u     how many raters judged item u
    n_k     how often choice k was made in all; n = Σ n_k
"""

import math

import numpy as np


def krippendorff_alpha(counts) -> float:
    r"""Krippendorff's alpha for choices without an order.

    $$\alpha = 1 - \frac{D_o}{D_e}, \qquad
      D_o = \frac{1}{n} \sum_u \sum_{k \ne l} \frac{n_{uk}\, n_{ul}}{n_u - 1}, \qquad
      D_e = \frac{1}{n (n - 1)} \sum_{k \ne l} n_k\, n_l$$

    D_o is how often two raters of one item differ, D_e how often two votes differ that are drawn
    from all. 1: all raters of an item agree; 0: they agree as votes drawn at random do; below 0:
    less than that. Raters may have left out items; an item with one vote says nothing and does not
    count. With equally many raters an item, alpha is Fleiss' kappa but for a factor:
    1 - alpha = (1 - kappa) (n - 1) / n.

    Not defined, and nan, when no item has two votes or when all votes are the same choice.

    Source: Krippendorff 2011, "Computing Krippendorff's alpha-reliability".

    Shapes: counts (N, K) -> a number.
    Raises: ValueError when counts is no table of whole numbers from 0 on.

    Two raters, ten items (the example of that text): they agree on 6.

    >>> both_0, both_1, differ = [2, 0], [0, 2], [1, 1]
    >>> round(krippendorff_alpha(5 * [both_0] + [both_1] + 4 * [differ]), 3)
    0.095
    """
    counts = np.asarray(counts, dtype=float)
    whole = counts.ndim == 2 and np.all(counts >= 0) and np.all(counts == np.floor(counts))
    if not whole:
        raise ValueError(
            f"counts of shape {counts.shape} should be a table (items, choices) of whole numbers "
            "from 0 on: how many raters made each choice"
        )
    counts = counts[counts.sum(1) > 1]
    n_u, n_k, n = counts.sum(1), counts.sum(0), counts.sum()
    differ_at_all = n**2 - (n_k**2).sum()
    if differ_at_all == 0:
        return math.nan
    differ_here = (n_u**2 - (counts**2).sum(1)) / (n_u - 1)
    return float(1 - (n - 1) * differ_here.sum() / differ_at_all)
