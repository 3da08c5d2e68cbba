"""Which pair comes when, and which dance stands on which side: drawn, and kept in a key.

Read first: `dancediff.user_study.pairs`.

The page knows pairs by ids that are drawn, too, and the sides as left and right. Which system
danced what stands in the key alone; without it answers cannot be scored.
"""

from dataclasses import dataclass

import numpy as np

from dancediff.user_study.pairs import Pair

LEFT, RIGHT = "left", "right"


@dataclass(frozen=True)
class BlindPair:
    """A pair as raters see it: under an id, the dances from left to right."""

    id: str
    pair: Pair
    swapped: bool  # whether the dance of the first system stands on the right

    @property
    def dances(self) -> tuple:
        """Left, right."""
        return self.pair.dances[::-1] if self.swapped else self.pair.dances

    def key(self) -> dict:
        """What only the key says."""
        left, right = self.pair.systems[::-1] if self.swapped else self.pair.systems
        return {"song": self.pair.song.name, LEFT: left, RIGHT: right}


def blind(pairs: list[Pair], generator: np.random.Generator) -> list[BlindPair]:
    """The pairs in an order that is drawn, with ids and sides that are drawn.

    Half of the pairs of each two systems are swapped (of an odd number, one more or less): who
    likes one side better then counts as much for one system as for the other.

    >>> pairs = [Pair(None, ("x", "y"), ("A", "B"))] * 4
    >>> shown = blind(pairs, np.random.default_rng(0))
    >>> sum(one.swapped for one in shown), {one.dances for one in shown} == {("x", "y"), ("y", "x")}
    (2, True)
    """
    shown: list[BlindPair] = []
    ids = [f"{number:08x}" for number in _distinct(len(pairs), generator)]
    for systems in dict.fromkeys(pair.systems for pair in pairs):
        ours = [pair for pair in pairs if pair.systems == systems]
        sides = (np.arange(len(ours)) + generator.integers(2)) % 2 == 0
        for pair, swapped in zip(ours, generator.permutation(sides), strict=True):
            shown.append(BlindPair(ids[len(shown)], pair, bool(swapped)))
    return [shown[k] for k in generator.permutation(len(shown))]


def _distinct(count: int, generator: np.random.Generator) -> list[int]:
    """Different numbers below 2^32."""
    found: dict[int, None] = {}
    while len(found) < count:
        found[int(generator.integers(1 << 32))] = None
    return list(found)
