r"""Counts in time: the beats of a song, and slow counts where it has none.

Read first: `dancediff.data.choreographer.structure`.

Where two beats lie more than `GAP` apart, before the first and after the last one, the music has no
beat, and slow counts lead from the one to the other. Where beats come too quickly to dance on each
of them, every second or third one is a count; where they come too slowly, every half one is, too.

Symbols (axes: f frames · k counts)
    beat   position of each frame on the counts                  (f,)
    pace   seconds each count lasts                              (k,)
    calm   share of a frame that is danced without a beat, 0..1  (f,)
    swing  how much of its groove a genre dances, 1 is usual     (f,)
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter

from dancediff.axes import FPS
from dancediff.data.choreographer.structure import IN_THREE, PHRASE

GAP = 2.2  # seconds; beats further apart have no beat between them
FEWEST = 4  # beats in a row; fewer are no beat yet
SLOW = 1.1  # seconds of a count where there is no beat
_COUNT = (0.34, 1.05)  # seconds, the quickest and the slowest count on a beat
CALM_SWING = 0.35  # of a genre's groove, where there is no beat
_NEAR = 9  # beats over which the tempo is looked at
_FADE = 5  # frames in which a dance goes over into a stretch without a beat


@dataclass(frozen=True)
class Grid:
    """The counts of a dance; see the module's symbols.

    anchors  seconds of the counts inside the song
    first    number of the first of them; counts before it are over when the dance begins
    gaps     counts (start, stop) without a beat
    phrase   counts of a phrase: 8, in bars of three 6
    spb      seconds a count lasts where there is a beat, the median
    """

    beat: np.ndarray
    anchors: np.ndarray
    first: int
    gaps: tuple[tuple[int, int], ...]
    phrase: int
    spb: float
    pace: np.ndarray
    calm: np.ndarray
    swing: np.ndarray

    @property
    def length(self) -> int:
        """Counts that have to be planned."""
        return int(np.ceil(self.beat[-1])) + 3

    def frame(self, count: float) -> int:
        """The first frame at or after a count."""
        return int(np.searchsorted(self.beat, count))


def make_grid(beats: np.ndarray, num_frames: int, meter: int | None = None) -> Grid:
    """Lay counts over a song of ``num_frames``; ``meter`` is how many beats a bar has.

    Shapes: beats (k,) seconds, increasing.

    >>> grid = make_grid(np.arange(6.0, 12, 0.5), 360)
    >>> grid.gaps, grid.anchors[3:7].round(3).tolist(), round(grid.spb, 3)
    (((0, 6),), [3.6, 4.8, 6.0, 6.5], 0.5)
    """
    seconds = num_frames / FPS
    threes = meter is not None and meter % 3 == 0
    quick = len(beats) > 1 and float(np.median(np.diff(beats))) < _COUNT[0]
    runs = [_danced(run, 3 if threes and quick else 2) for run in _runs(beats)]
    anchors, slow = _with_slow_counts(runs, seconds)
    beat = beat_position(anchors, num_frames)
    first = round(float(np.interp(anchors[0] * FPS, np.arange(len(beat)), beat)))
    counts = int(np.ceil(beat[-1])) + 3
    gaps = _gaps(slow, first, counts)
    each = np.diff(anchors)
    on_beat = each[~slow] if not slow.all() else each
    pace = median_filter(each, min(_NEAR, len(each)), mode="nearest")
    pace = pace[np.clip(np.arange(counts) - first, 0, len(pace) - 1)]
    silent = [(beat >= a - 1) & (beat < b) for a, b in gaps]
    calm = gaussian_filter1d(np.any([*silent, np.zeros(len(beat), bool)], 0).astype(float), _FADE)
    phrase = IN_THREE if threes and not quick else PHRASE
    swing = 1 - (1 - CALM_SWING) * calm
    return Grid(beat, anchors, first, gaps, phrase, float(np.median(on_beat)), pace, calm, swing)


def beat_position(beats: np.ndarray, num_frames: int) -> np.ndarray:
    """Where each frame lies on the beat grid, carried on evenly beyond its ends, (f,).

    Between beats the position goes smoothly from one tempo to the next. The grid is shifted so that
    every frame lies after beat 1: steps may begin before the clip.

    >>> beat_position(np.array([0.5, 1.0, 1.5, 2.0]), 31)[[0, 15, 30]].tolist()
    [1.0, 2.0, 3.0]
    """
    from scipy.interpolate import PchipInterpolator

    time = np.arange(num_frames) / FPS
    first, last = beats[1] - beats[0], beats[-1] - beats[-2]
    index = np.arange(-1.0, len(beats) + 1)
    ends = np.concatenate([[beats[0] - first], beats, [beats[-1] + last]])
    at = PchipInterpolator(ends, index)(time)
    at = np.where(time < beats[0], (time - beats[0]) / first, at)
    at = np.where(time > beats[-1], index[-2] + (time - beats[-1]) / last, at)
    return at + max(0, int(np.ceil(1 - at[0])))


def _runs(beats: np.ndarray) -> list[np.ndarray]:
    """Stretches of beats that follow each other without a gap."""
    runs = np.split(beats, np.flatnonzero(np.diff(beats) > GAP) + 1)
    return [run for run in runs if len(run) >= FEWEST]


def _danced(run: np.ndarray, skip: int) -> np.ndarray:
    """The counts of one stretch: each beat, every ``skip``-th of quick ones, halves of slow ones.

    >>> _danced(np.arange(9) * 0.25, 2).tolist()
    [0.0, 0.5, 1.0, 1.5, 2.0]
    >>> _danced(np.arange(4) * 1.5, 2).tolist()
    [0.0, 0.75, 1.5, 2.25, 3.0, 3.75, 4.5]
    """
    quickest, slowest = _COUNT
    each = median_filter(np.diff(run), min(_NEAR, len(run) - 1), mode="nearest")
    kept, k = [], 0
    while k < len(run):
        kept.append(run[k])
        k += skip if k < len(each) and each[k] < quickest else 1
    out: list[float] = []
    for a, b in pairwise(kept):
        out += [a, (a + b) / 2] if b - a > slowest else [a]
    return np.array([*out, kept[-1]])


def _with_slow_counts(runs: list[np.ndarray], seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """All counts from the first to the last, (k,), and which of their intervals are slow, (k - 1,).

    Slow counts share a gap evenly, so that the last one meets the beat.
    """
    if not runs:
        count = max(2, round(seconds / SLOW))
        return np.linspace(0, max(seconds, SLOW), count + 1), np.ones(count, bool)
    ends = [np.array([0.0]), *runs, np.array([seconds])]
    at, slow = [runs[0][:1]], []
    for before, run in pairwise(ends):
        gap = float(run[0] - before[-1])
        if gap > GAP:
            even = np.linspace(before[-1], run[0], max(2, round(gap / SLOW)) + 1)
            at.append(even[:-1] if before is ends[0] else even[1:])
            slow.append(np.ones(len(even) - 1, bool))
        at.append(run[1:])
        slow.append(np.zeros(len(run) - 1, bool))
    if runs[0][0] > GAP:
        at[:2] = at[1], at[0]
    return np.concatenate(at), np.concatenate(slow)


def _gaps(slow: np.ndarray, first: int, counts: int) -> tuple[tuple[int, int], ...]:
    """Counts (start, stop) of the gaps: after the last beat, up to the first one that is back.

    >>> _gaps(np.array([True, True, False, False, True, True]), 1, 12)
    ((0, 3), (6, 12))
    """
    edge = np.diff(np.concatenate([[0], slow.astype(int), [0]]))
    starts, stops = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
    return tuple(
        (first + a + 1 if a else 0, first + b if b < len(slow) else counts)
        for a, b in zip(starts.tolist(), stops.tolist(), strict=True)
    )
