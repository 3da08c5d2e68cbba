"""Exercises of lesson 15: Live.

Read first: notebook 15 · `dancediff.exercises.exercise`.
"""

from collections.abc import Callable

import numpy as np

from dancediff.exercises.shared import unlike
from dancediff.music.next_beat import beat_line, coming_beats

PIECES = 6  # of a pretended dance


class _PretendedStream:
    """Hands out numbers for pieces: the energy that each was danced with."""

    def __init__(self):
        self._energy, self._left = 1.0, PIECES

    def set(self, **knobs: float) -> None:
        self._energy = knobs.get("energy", self._energy)

    def __iter__(self):
        return self

    def __next__(self) -> float:
        if not self._left:
            raise StopIteration
        self._left -= 1
        return self._energy


def _begin() -> _PretendedStream:
    return _PretendedStream()


def _steer(begin: Callable, wishes: dict) -> list:
    stream, pieces = begin(), []
    stream.set(**wishes.get(0, {}))
    for piece in stream:
        pieces.append(piece)
        if len(pieces) in wishes:
            stream.set(**wishes[len(pieces)])
    return pieces


def _wishes() -> list[tuple]:
    asked = [
        {2: {"energy": 0.25}, 4: {"energy": 1.75}},
        {0: {"energy": 0.5}, 1: {"energy": 2.0}, 5: {"energy": 0.125}},
        {},
    ]
    return [(_begin, wishes) for wishes in asked]


def _most_overlap(frames: int, seconds: float) -> int:
    return int(np.floor(frames - 30 * seconds + 1e-9))


def _windows() -> list[tuple]:
    return [(150, 1.75), (150, 2.5), (120, 0.31), (60, 1.99), (150, 0.1)]


def _next_beats(past, now: float, until: float):
    return coming_beats(np.asarray(past), now, until)


def _heard() -> list[tuple]:
    draw = np.random.default_rng(0)
    steady = 0.3 + 0.5 * np.arange(9)
    trembling = steady + draw.normal(0, 0.004, 9)
    missing = np.delete(0.2 + 0.6 * np.arange(11), [1, 7])  # one gap of two among the last eight
    slower = np.concatenate([0.4 * np.arange(30), 11.6 + 0.55 * np.arange(1, 17)])
    return [
        (steady, 4.4, 7.4),
        (trembling, 5.1, 8.0),
        (missing, 6.3, 9.5),
        (slower, 20.6, 23.5),
    ]


def _foretells(got, past, now: float, until: float) -> str:
    """Every beat that goes on evenly is foretold to within 60 ms, and no other."""
    want = _next_beats(past, now, until)
    if wrong := unlike(np.asarray(got, dtype=float), want.shape, np.ndarray):
        return f"{wrong}: {len(want)} beats come after {now:g} s and up to {until:g} s"
    off = np.abs(np.asarray(got, dtype=float) - want)
    if off.max() > 0.06:
        k = int(off.argmax())
        pace = beat_line(np.asarray(past))[1]
        return (
            f"yours has beat {k} at {np.asarray(got)[k]:.2f} s, one goes on at {want[k]:.2f} s "
            f"(every {pace:.2f} s)"
        )
    return ""


FEWEST = 4  # steps of a piece that was made in a hurry


def _play(costs: list, frames: list, steps: int, lead: float) -> np.ndarray:
    rows, ready, played = [], 0.0, 0.0
    for k, cost in enumerate(costs):
        begun = max(ready, played - lead)
        ready = begun + steps * cost
        rows.append((begun, ready, max(ready, played), steps))
        if k and ready > played:
            steps = max(steps // 2, FEWEST)
        played = rows[-1][2] + frames[k] / 30
    return np.array(rows)


def _computers() -> list[tuple]:
    """One that is busy for a while, one too slow, one with little lead, one that mostly rests."""
    return [
        ([0.2, 0.2, 0.25, 0.9, 0.2, 0.3, 0.2], [75, 75, 60, 90, 75, 30, 75], 8, 3.0),
        ([0.3, 0.31, 0.3, 0.42, 0.9, 0.3], [45, 75, 45, 60, 45, 75], 22, 4.0),
        ([0.1, 0.05, 0.3, 0.04, 0.11], [75, 60, 75, 90, 75], 13, 0.8),
        ([0.06, 0.05, 0.04, 0.02, 0.05, 0.05, 0.05, 0.07], [75] * 4 + [60] * 4, 10, 2.6),
    ]


SPECS = {
    "15.1": {"spec": _steer, "cases": _wishes},
    "15.3": {"spec": _most_overlap, "cases": _windows},
    "15.4": {"spec": _next_beats, "cases": _heard, "accepts": _foretells},
    "15.5": {"spec": _play, "cases": _computers},
}
