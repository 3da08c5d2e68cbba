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


def tracker(*, shortest=0.5, longest=2.0, cost=None, start=0.0, pick=None, last=None):
    """A beat tracker in which one part is another."""
    cost = cost or (lambda gaps, p: np.log(gaps / p) ** 2)
    last = last or (lambda best, p: best.argmax())

    def answer(onset, period, tightness):
        best, before = np.array(onset, dtype=float), np.full(len(onset), -1)
        gaps = np.arange(np.ceil(shortest * period), np.floor(longest * period) + 1).astype(int)
        costs = tightness * cost(gaps, period)
        for i in range(gaps[0], len(onset)):
            near = gaps[gaps <= i]
            totals = best[i - near] - costs[: len(near)]
            k = (totals if pick is None else pick(best, i - near)).argmax()
            if totals[k] > start:
                best[i], before[i] = best[i] + totals[k], i - near[k]
        beats = [last(best, period)]
        while before[beats[-1]] >= 0:
            beats.append(before[beats[-1]])
        return np.array(beats[::-1])

    return answer


def steps_of_one_period(onset, period, tightness):
    """Even beats, at the phase that is strongest."""
    rows = [np.arange(k, len(onset), round(period)) for k in range(min(len(onset), round(period)))]
    return max(rows, key=lambda row: onset[row].sum())


def strongest_next(onset, period, tightness):
    """From the strongest beginning always to the best next frame, which looks no farther."""
    beats = [int(np.argmax(onset[: int(period)]))]
    gaps = np.arange(np.ceil(period / 2), 2 * period).astype(int)
    while beats[-1] + gaps[-1] < len(onset):
        worth = onset[beats[-1] + gaps] - tightness * np.log(gaps / period) ** 2
        beats.append(int(beats[-1] + gaps[worth.argmax()]))
    return beats


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
    "02.7": [
        tracker(shortest=0.75),
        tracker(longest=1.0),  # hurries only
        tracker(longest=1.95),  # less than twice the period
        tracker(longest=2.2),
        tracker(cost=lambda gaps, p: np.abs(np.log(gaps / p))),  # no square
        tracker(cost=lambda gaps, p: np.log10(gaps / p) ** 2),  # another logarithm
        tracker(cost=lambda gaps, p: np.log2(gaps / p) ** 2),
        tracker(cost=lambda gaps, p: (gaps / p - 1) ** 2),  # no logarithm
        tracker(cost=lambda gaps, p: np.log(gaps / int(p)) ** 2),  # the period without its fraction
        tracker(cost=lambda gaps, p: -(np.log(gaps / p) ** 2)),  # a reward
        tracker(cost=lambda gaps, p: 0 * gaps),  # anything goes
        tracker(start=-np.inf),  # never a first beat in the middle
        tracker(start=np.inf),  # one beat
        tracker(pick=lambda best, j: best[j]),  # the gap costs, but does not count in the choice
        tracker(pick=lambda best, j: j),  # always the shortest gap
        tracker(last=lambda best, p: len(best) - 1),  # ends with the song
        tracker(last=lambda best, p: len(best) - 1 - best[::-1][: int(p)].argmax()),
        steps_of_one_period,
        strongest_next,
        lambda onset, period, tightness: np.flatnonzero(onset > onset.mean()),  # peaks
        lambda onset, period, tightness: tracker()(onset, period, tightness)[::-1],
        lambda onset, period, tightness: tracker()(onset, period, tightness)[1:],
        lambda onset, period, tightness: tracker()(onset, period, tightness) / 30,  # seconds
        lambda onset, period, tightness: tracker()(onset, period, 0.1 * tightness),
    ],
}
