r"""What people do while the music has no beat: they breathe, or walk slowly to another formation.

All genres share these moves (``shared.toml``), and how one goes from the one to the next.
"""

import tomllib
from pathlib import Path

import numpy as np

from dancediff.data.choreographer.moves import Move, Style

_SHARED = tomllib.loads(Path(__file__).with_name("shared.toml").read_text(encoding="utf-8"))
BREATHS = tuple(Move(energy=1, **move) for move in _SHARED["breath"])
WALKS = tuple(Move(energy=1, **move) for move in _SHARED["walk"])
CALM = Style(attack=1.0, flow=0.75, lag=0.1, smooth=3.0)


def breathing(n: int, rng: np.random.Generator) -> list[list[Move]]:
    """The order in which each of n dancers goes through the moves; half the time all the same."""
    together = rng.random() < 0.5
    first = rng.permutation(len(BREATHS))
    orders = [first if together else rng.permutation(len(BREATHS)) for _ in range(n)]
    return [[BREATHS[i] for i in order] for order in orders]
