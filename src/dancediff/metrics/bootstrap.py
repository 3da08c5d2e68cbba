r"""How far a number about a set of dances would move with another set of dances.

Symbols (axes: N samples)
    samples  what the number is computed from, one entry for each dance   N entries
    t        the number, of the samples
    t*       the number of N samples drawn from them with replacement
"""

from collections.abc import Callable, Sequence

import numpy as np
from torch import Tensor


def bootstrap_interval(
    statistic: Callable[..., float],
    samples: Tensor | np.ndarray | Sequence,
    *,
    level: float = 0.95,
    draws: int = 200,
    seed: int = 0,
) -> tuple[float, float]:
    r"""An interval for what a statistic is, on average, of N samples.

    $$\big(t + Q_{\alpha}(t^*) - \overline{t^*},\;\; t + Q_{1-\alpha}(t^*) - \overline{t^*}\big),
      \qquad \alpha = (1 - \text{level}) / 2$$

    with Q quantiles. A draw repeats some samples, and FID punishes that as it punishes a small
    set: t* lies above t, often all of it, and the plain percentile interval need not even contain
    the number beside it. So the draws are moved until their mean is t. Their mean, not a guess at
    the number of infinitely many samples: where N is not much larger than the features' dimension
    no bootstrap can guess that. Compare intervals of equal N only. Of a mean this is the percentile
    interval: the draws are balanced (each sample occurs ``draws`` times in all), so the mean of t*
    is t.

    One entry of ``samples`` must be one independent thing: a dance, with all its dancers, and not
    a dancer, who moves like the others. Draws of which the statistic is nan are left out.

    Source: Efron 1979; balanced draws: Davison, Hinkley and Schechtman 1986.

    Shapes: samples (N, ...) or a list of N, handed to ``statistic`` as it is: a tensor, an array,
    or a list -> (low, high).
    Raises: ValueError for less than 2 samples, an impossible ``level`` or ``draws``, a statistic
    that is nan of the samples or of half of the draws.

    >>> low, high = bootstrap_interval(np.mean, np.arange(101.0))
    >>> low < 50 < high
    True
    """
    n = len(samples)
    if n < 2:
        raise ValueError(f"samples has {n} entries; an interval needs 2 or more")
    if not 0 < level < 1:
        raise ValueError(f"level={level} must lie between 0 and 1, such as 0.95")
    if draws < 2:
        raise ValueError(f"draws={draws} must be 2 or more; 200 is usual")
    rows = np.random.default_rng(seed).permutation(np.tile(np.arange(n), draws)).reshape(draws, n)
    t = float(statistic(samples))
    again = np.array([float(statistic(_pick(samples, row))) for row in rows])
    again = again[np.isfinite(again)]
    if not np.isfinite(t) or 2 * len(again) <= draws:
        raise ValueError(
            f"statistic is {t} of all samples and finite in {len(again)} of {draws} draws; "
            "leave out samples of which it is not defined, or add samples"
        )
    low, high = np.quantile(again, ((1 - level) / 2, (1 + level) / 2))
    shift = t - again.mean()
    if abs(shift) <= 1e-9 * np.abs(again).max():  # rounding, which would give -1e-17 for 0
        shift = 0.0
    return float(low + shift), float(high + shift)


def _pick(samples, rows: np.ndarray):
    """The samples of some rows, in the container they came in."""
    if isinstance(samples, Tensor | np.ndarray):
        return samples[rows]
    return [samples[k] for k in rows]
