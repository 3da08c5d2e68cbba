r"""When the next beat comes: an even beat goes on as it went.

Read first: `dancediff.music.online_beats`.

Symbols (axes: k beats)
    t    seconds of the beats so far                 (k,)
    T    seconds between two beats
"""

import numpy as np

RECENT = 8  # beats whose pace goes on: two bars
_FEWEST = 3  # beats that make a pace


def beat_line(t: np.ndarray) -> tuple[float, float]:
    r"""The last beat and the period of the even beat that fits the recent ones best.

    $$t_k \approx t_0 + k\,T \quad \text{(least squares over the last eight beats)}$$

    A beat that was not found leaves a gap; it counts as many beats as it has the length of.

    Source: ours. Shapes: t (k,), ascending -> seconds of the last beat, seconds between beats; both
    are nan with fewer than three beats.

    >>> t, T = beat_line(np.array([1.0, 1.5, 2.0, 3.0]))                     # one is missing
    >>> round(t, 3), round(T, 3)
    (3.0, 0.5)
    """
    t = np.asarray(t, dtype=float)[-RECENT:]
    if len(t) < _FEWEST:
        return float("nan"), float("nan")
    gaps = np.diff(t)
    k = np.concatenate([[0], np.cumsum(np.maximum(1, np.round(gaps / np.median(gaps))))])
    T = float(((k - k.mean()) * (t - t.mean())).sum() / ((k - k.mean()) ** 2).sum())
    return float(t.mean() + T * (k[-1] - k.mean())), T


def coming_beats(t: np.ndarray, now: float, until: float) -> np.ndarray:
    """Beats after ``now``, up to ``until``, if the beat goes on; none without a pace.

    Shapes: t (k,), all in seconds -> (j,).

    >>> coming_beats(np.array([0.0, 0.5, 1.0]), 1.2, 2.6).round(3).tolist()
    [1.5, 2.0, 2.5]
    """
    last, T = beat_line(t)
    if not T > 0:
        return np.zeros(0)
    first = np.floor((now - last) / T) + 1
    beats = last + T * np.arange(first, np.floor((until - last) / T) + 1)
    return beats[beats > now]
