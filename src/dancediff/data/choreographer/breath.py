r"""Moves that all genres share (``shared.toml``).

While the music has no beat, people breathe, or walk slowly to another formation. When it becomes
loud all at once, they accent it; when it breaks off, they hold what they do.
"""

import tomllib
from pathlib import Path

import numpy as np

from dancediff.data.choreographer.moves import Move, Style

_SHARED = tomllib.loads(Path(__file__).with_name("shared.toml").read_text(encoding="utf-8"))
BREATHS = tuple(Move(energy=1, **move) for move in _SHARED["breath"])
WALKS = tuple(Move(energy=1, **move) for move in _SHARED["walk"])
STROLL = Move(energy=1, **_SHARED["stroll"])  # a way to another formation, to quiet music
ACCENTS = tuple(Move(energy=3, whole=True, **move) for move in _SHARED["accent"])
ACCENT_COUNTS = 4  # of an accent's eight, then the dance goes on
HOLD = Move("hold", "", ".")
BREATHING = frozenset(move.name for move in (*BREATHS, *WALKS))
CALM = Style(attack=1.0, flow=0.75, lag=0.1, smooth=3.0)


def breathing(n: int, rng: np.random.Generator) -> list[list[Move]]:
    """The order in which each of n dancers goes through the moves; half the time all the same."""
    together = rng.random() < 0.5
    first = rng.permutation(len(BREATHS))
    orders = [first if together else rng.permutation(len(BREATHS)) for _ in range(n)]
    return [[BREATHS[i] for i in order] for order in orders]
