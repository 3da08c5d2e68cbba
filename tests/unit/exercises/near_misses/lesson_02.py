"""Plausible wrong answers to the exercises of lesson 02: What the model hears."""

from itertools import pairwise

import numpy as np


def beat_frames(M):
    return np.flatnonzero(np.asarray(M)[:, 34] > 0.5)


def slice_first(sound, starts, features):
    return np.stack([features(sound[512 * s : 512 * (s + 150)])[:150] for s in starts])


def gaps_of(borders, longest=2.2):
    borders = [float(time) for time in borders]
    return [(a, b) for a, b in pairwise(borders) if b - a > longest]


def believes(**changed):
    """The right beliefs but for some, by their first letters."""
    right = {
        "the intro has beats": False,
        "the intro has energy 0": False,
        "the break has less energy than the drums before it": True,
        "half as loud, the song has less energy": False,
        "every beat has confidence 1": False,
    }
    names = {"beats": 0, "zero": 1, "pause": 2, "half": 3, "sure": 4}
    keys = list(right)
    return right | {keys[names[name]]: value for name, value in changed.items()}


NEAR_MISSES = {
    "02.1": [
        lambda: np.full((128, 2), -40.0),  # nothing begins
        lambda: np.tile([-40.0, -20.0], (128, 1)),  # both hear it
        lambda: np.tile([-20.0, -40.0], (128, 1)),  # nobody does
        lambda: np.repeat([[-42.0, -38.0], [-38.0, -42.0]], 64, axis=0),  # too faint
        lambda: np.repeat([[-40.0, 20.0], [-40.0, -100.0]], 64, axis=0),  # no such decibels
        lambda: np.repeat([[-60.0, -20.0], [-20.0, -60.0]], 64, axis=0).T,
    ],
    "02.2": [
        lambda M: 60 * 30 / np.diff(beat_frames(M)).mean(),  # minds a missing beat
        lambda M: 60 / np.median(np.diff(beat_frames(M))),  # takes frames for seconds
        lambda M: 60 * 30 * len(beat_frames(M)) / len(M),
        lambda M: np.diff(beat_frames(M)),
        lambda M: 60 * 30 / np.diff(beat_frames(M)).min(),  # the smallest gap: beats are rounded
        lambda M: 120.0,  # that of the lesson's song
        lambda M: 60 * 25 / np.median(np.diff(beat_frames(M))),  # another frame rate
        lambda M: 30 / np.median(np.diff(beat_frames(M))),  # a second
    ],
    "02.3": [
        {"onset": True, "mfcc": True, "chroma": False, "peaks": False, "beats": False},
        {"onset": True, "mfcc": True, "chroma": True, "peaks": False, "beats": False},
        {"onset": False, "mfcc": False, "chroma": False, "peaks": False, "beats": False},
        {"onset": True, "mfcc": True, "chroma": True, "peaks": True, "beats": True},
    ],
    "02.4": [
        slice_first,  # what EDGE does
        lambda sound, starts, features: np.stack(
            [features(sound[s : s + 512 * 150])[:150] for s in starts]
        ),  # takes frames for samples
        lambda sound, starts, features: np.stack(
            [features(sound[: 512 * (s + 150)])[s : s + 150] for s in starts]
        ),  # knows the past, not what is to come
        lambda sound, starts, features: np.stack([features(sound)[s : s + 151] for s in starts]),
        lambda sound, starts, features: np.stack([features(sound)[:150] for s in starts]),
        lambda sound, starts, features: features(sound),
    ],
    "02.5": [
        believes(beats=True),
        believes(zero=True),
        believes(pause=False),  # nothing is true
        believes(half=True),
        believes(sure=True),
    ],
    "02.6": [
        lambda beats, seconds: gaps_of(beats),  # forgets the intro and the end
        lambda beats, seconds: gaps_of([0, *beats]),  # forgets the end
        lambda beats, seconds: gaps_of([*beats, seconds]),  # forgets the intro
        lambda beats, seconds: gaps_of([0, *beats, seconds], 2.2 - 1e-6),  # not more than 2.2 s
        lambda beats, seconds: gaps_of([0, *beats, seconds], 1.0),  # two missed beats are a break
        lambda beats, seconds: (
            gaps_of([0, *beats, seconds], 2 * np.median(np.diff(beats))) if len(beats) else []
        ),
        lambda beats, seconds: gaps_of([0, *beats, seconds]) if len(beats) else [],
        lambda beats, seconds: [b - a for a, b in gaps_of([0, *beats, seconds])],  # how long only
        lambda beats, seconds: [(0, seconds)],
        lambda beats, seconds: gaps_of([0, *beats, seconds])[:1],  # the first only
        lambda beats, seconds: gaps_of([0, *beats[::-1], seconds]),  # unsorted
        lambda beats, seconds: [(b, a) for a, b in gaps_of([0, *beats, seconds])],  # stop, start
    ],
}
