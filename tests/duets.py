"""Duets to a steady beat, for tests that dance windows."""

import numpy as np
import torch

from dancediff.data.choreographer import choreograph
from dancediff.data.take import DanceTake
from dancediff.music.features import BEATS


def duets(count: int = 4) -> list[DanceTake]:
    """Six seconds each, a beat every half second."""
    beats = np.arange(0.5, 6.0, 0.5)
    M = torch.zeros(180, 35)
    M[(beats * 30).astype(int), BEATS] = 1
    return [
        DanceTake(f"duo {k}", choreograph(beats, dancers=2, seed=k, seconds=6)[0], M=M)
        for k in range(count)
    ]
