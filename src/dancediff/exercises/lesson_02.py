"""Exercises of lesson 02: What the model hears.

Read first: notebook 02 · `dancediff.exercises.exercise`.
"""

from itertools import pairwise

import numpy as np
import torch

from dancediff.axes import FPS
from dancediff.music.features import BEATS, HOP, beat_frames
from dancediff.music.sections import LONGEST_BEAT


def _new_tone():
    S = np.full((128, 2), -40.0)
    S[:64, 1], S[64:, 1] = -60, -20
    return S


def _hears_a_tone(got) -> str:
    S = np.asarray(got, dtype=float)
    if S.shape != (128, 2):
        return f"shape {S.shape}, expected (128, 2)"
    if not ((S >= -80) & (S <= 0)).all():
        return "some of your numbers are outside -80 … 0 decibels"
    change = S[:, 1] - S[:, 0]
    onset = np.maximum(0, change).mean()
    if onset < 5 - 1e-6:
        return f"the onset strength is {onset:.1f}, expected 5 or more"
    shortcut = max(0, change.mean())
    return f"the shortcut hears {shortcut:.1f}, expected 0" if shortcut > 1e-6 else ""


def _tempo(M):
    return 60 * FPS / float(np.median(np.diff(beat_frames(M))))


def _tempo_cases() -> list[tuple]:
    steady, gap, rounded = torch.zeros(3, 300, 35)
    steady[7::15, BEATS] = 1  # 120 beats a minute
    gap[7::20, BEATS] = 1  # 90, and the tracker has missed two
    gap[[67, 187], BEATS] = 0
    rounded[np.cumsum([7, 15, 14, 15, 15, 16, 15, 14, 15, 15, 31, 15, 16]), BEATS] = 1
    return [(steady,), (gap,), (rounded,)]


class _Rises:
    """Loudness rises, and their share of the largest one: features that need the whole song."""

    def __call__(self, sound):
        frames = 1 + len(sound) // HOP
        padded = np.pad(np.abs(sound), (0, frames * HOP - len(sound)))
        loud = padded.reshape(frames, HOP).mean(1)
        rises = np.maximum(0, np.diff(loud, prepend=loud[0]))
        return np.stack([rises, rises / rises.max()], axis=1)

    def __repr__(self):
        return "features"


def _cut_last(sound, starts, features):
    M = features(sound)
    return np.stack([M[start : start + 150] for start in starts])


def _cut_cases() -> list[tuple]:
    sound = np.random.default_rng(0).normal(size=400 * HOP + 100)
    sound *= np.repeat(np.random.default_rng(1).random(401), HOP)[: len(sound)]
    return [(sound, [0, 75, 250], _Rises()), (sound[: 200 * HOP], [7], _Rises())]


def _same_windows(got, *case) -> str:
    want = _cut_last(*case)
    got = np.asarray(got)
    if got.shape != want.shape:
        return f"shape {got.shape}, expected {want.shape}"
    wrong = np.flatnonzero(~np.isclose(got, want).all(axis=(0, 2)))
    return f"frame {wrong[0]} of your windows is not that of the song" if len(wrong) else ""


def _without_beat(beats, seconds):
    borders = [0.0, *np.asarray(beats).tolist(), seconds]
    return [(a, b) for a, b in pairwise(borders) if b - a > LONGEST_BEAT]


def _tapped() -> list[tuple]:
    steady = np.arange(0.5, 30, 0.5)
    pausing = np.concatenate([np.arange(9, 20, 0.6), np.arange(28, 38, 0.6)])
    missed = np.delete(steady, [7, 8, 30])  # two in a row: 1.5 s without a beat
    late = np.array([2.2, 4.4, 6.7])  # as far apart as beats may be, and a little more
    none = np.zeros(0)
    return [(pausing, 40.0), (steady, 30.0), (missed, 30.0), (late, 7.0), (none, 12.0), (none, 2.0)]


def _same_stretches(got, beats, seconds) -> str:
    want = np.reshape(_without_beat(beats, seconds), (-1, 2))
    got = np.asarray(got, dtype=float)
    where = f"{len(beats)} beats in {seconds:.1f} s"
    if got.size == 0 == want.size:
        return ""
    if got.shape != want.shape:
        return f"shape {got.shape}, expected {want.shape} for {where}"
    wrong = np.flatnonzero(np.abs(got - want).max(1) > 1e-6)
    k = wrong[0] if len(wrong) else 0
    return f"stretch {k} is {got[k]}, expected {want[k]} for {where}" if len(wrong) else ""


def _track(onset, period, tightness):
    best, before = np.array(onset, dtype=float), np.full(len(onset), -1)
    gaps = np.arange(1, len(onset))
    gaps = gaps[(gaps >= period / 2) & (gaps <= 2 * period)]
    cost = tightness * np.log(gaps / period) ** 2
    for i in range(len(onset)):
        totals = best[i - gaps[gaps <= i]] - cost[gaps <= i]
        if totals.max(initial=0) > 0:
            best[i] += totals.max()
            before[i] = i - gaps[totals.argmax()]
    beats = [int(best.argmax())]
    while before[beats[-1]] >= 0:
        beats.append(int(before[beats[-1]]))
    return np.array(beats[::-1])


def _drummed(f, period, seed, *, mean=0.0) -> np.ndarray:
    """Onset strength of drums that hurry and drag, of which some are missed; and of other sounds.

    ``mean`` is taken away; then silence, of which there is some before and behind, is below 0.
    """
    draw = np.random.default_rng(seed)
    onset = 0.6 * draw.random(f) ** 4
    beats = np.cumsum(period * draw.uniform(0.85, 1.15, int(f / period)))
    onset[beats[(beats < 0.85 * f) & (draw.random(len(beats)) < 0.8)].astype(int)] += 1.5
    onset[: int(0.15 * f)] = onset[int(0.85 * f) :] = 0
    return onset - mean


def _tracked() -> list[tuple]:
    sparse = np.full(90, -2.0)  # beats as far apart as they may be, or a frame more
    sparse[[5, 25, 45, 50, 71, 76]] = 3.0
    return [
        (_drummed(240, 20, 0), 20, 2.0),
        (_drummed(200, 13.4, 1, mean=0.2), 13.4, 4.0),
        (_drummed(150, 6.5, 2, mean=0.3), 6.5, 3.0),
        (np.random.default_rng(3).random(100), 4.5, 6.0),  # every frame is worth something
        (sparse, 10, 1.0),
        (np.array([0.2, 0.9, 0.1]), 12.5, 1.0),  # too short for two
    ]


def _is_best(got, onset, period, tightness) -> str:
    beats = np.asarray(got)
    where = f"for {len(onset)} frames and a period of {period}"
    if beats.ndim != 1 or not len(beats) or not np.isin(beats, np.arange(len(onset))).all():
        return f"expected one frame or several, from 0 to {len(onset) - 1}, {where}"
    gaps = np.diff(beats)
    wrong = gaps[(gaps < period / 2) | (gaps > 2 * period)]
    if len(wrong):
        return f"a gap is {wrong[0]} frames, expected {period / 2} to {2 * period}, {where}"
    best = _track(onset, period, tightness)
    yours, most = (
        onset[b.astype(int)].sum() - tightness * (np.log(np.diff(b) / period) ** 2).sum()
        for b in (beats, best)
    )
    if yours >= most - 1e-4:
        return ""
    counted = f"your total is {yours:.3f} (beats: {len(beats)})"
    return f"{counted}, expected {most:.3f} (beats: {len(best)}), {where}"


SPECS = {
    "02.1": {"spec": _new_tone, "accepts": _hears_a_tone},
    "02.2": {"spec": _tempo, "cases": _tempo_cases},
    "02.4": {"spec": _cut_last, "cases": _cut_cases, "accepts": _same_windows},
    "02.6": {"spec": _without_beat, "cases": _tapped, "accepts": _same_stretches},
    "02.7": {"spec": _track, "cases": _tracked, "accepts": _is_best},
}
