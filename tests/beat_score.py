"""How well two lists of beats agree."""

import numpy as np


def beat_f_score(found: np.ndarray, truth: np.ndarray, *, tolerance: float = 2) -> float:
    r"""How well detected beats agree with the truth: $F = 2PR / (P + R)$.

    A beat is hit when one of the other list lies within ``tolerance`` (frames, or whatever unit
    both lists are in).

    >>> beat_f_score(np.array([10, 20, 30]), np.array([11, 20, 31, 40]))
    0.8571428571428571
    """
    if len(found) == 0 or len(truth) == 0:
        return 0.0
    gap = np.abs(np.asarray(found)[:, None] - np.asarray(truth)[None])
    precision = float((gap.min(1) <= tolerance).mean())
    recall = float((gap.min(0) <= tolerance).mean())
    return 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0
