"""Exercises of lesson 02: What the model hears."""

import numpy as np
import torch

from dancediff.axes import FPS
from dancediff.music.features import BEATS, HOP, beat_frames


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
    steady, gap = torch.zeros(300, 35), torch.zeros(300, 35)
    steady[7::15, BEATS] = 1  # 120 beats a minute
    gap[7::20, BEATS] = 1  # 90, and the tracker has missed two
    gap[[67, 187], BEATS] = 0
    return [(steady,), (gap,)]


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


SPECS = {
    "02.1": {"spec": _new_tone, "accepts": _hears_a_tone},
    "02.2": {"spec": _tempo, "cases": _tempo_cases},
    "02.4": {"spec": _cut_last, "cases": _cut_cases, "accepts": _same_windows},
}
