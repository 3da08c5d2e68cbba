"""Exercises of lesson 15: Live."""

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
    missing = np.delete(0.2 + 0.6 * np.arange(11), [4, 7])
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


SPECS = {
    "15.1": {"spec": _steer, "cases": _wishes},
    "15.3": {"spec": _most_overlap, "cases": _windows},
    "15.4": {"spec": _next_beats, "cases": _heard, "accepts": _foretells},
}
