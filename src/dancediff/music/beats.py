r"""Beats in a feature matrix.

Symbols (axes: f frames at 30 fps)
    M   music features   (f, 35), column 34 is 1 where a beat falls
"""

import numpy as np
from torch import Tensor

from dancediff.music.features import BEATS


def beat_frames(M: Tensor) -> np.ndarray:
    """Frames on which a beat falls; (f, 35) -> int (k,).

    >>> import torch
    >>> M = torch.zeros(40, 35)
    >>> M[[5, 20], 34] = 1
    >>> beat_frames(M).tolist()
    [5, 20]
    """
    return np.flatnonzero(M[:, BEATS.start].numpy() > 0.5)
