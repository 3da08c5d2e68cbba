"""Plausible wrong answers to the exercises of lesson 00, Tour: music in, dance out."""

import numpy as np


def song(*, beat=60.0, kick=0.9, click=0.3, off=0.5, every=1, last=1, lasts=0.15, other=None):
    """A song in which one part is another; ``beat`` is 60, to be divided by bpm."""

    def drum(loud, pitch, decay, rate):
        s = np.arange(round(lasts * rate)) / rate
        return loud * np.cos(2 * np.pi * pitch * s) * np.exp(-s / decay)

    def answer(bpm, bars, rate):
        length, per_second = beat / bpm, other or rate
        out = np.zeros(round(4 * bars * length * per_second))
        for k in range(0, 4 * (bars - last), every):
            hits = (k, drum(kick, 60, lasts / 5, rate)), (k + off, drum(click, 1000, 0.01, rate))
            for when, sound in hits:
                first = round(when * length * per_second)
                out[first : first + len(sound)] += sound[: len(out) - first]
        return out

    return answer


def song_of_noise_under_it(bpm, bars, rate):
    out = song()(bpm, bars, rate)
    return out + 0.1 * np.random.default_rng(0).uniform(-1, 1, len(out))


def song_in_columns(bpm, bars, rate):
    return np.stack([song()(bpm, bars, rate)] * 2, axis=1)


NEAR_MISSES = {
    "00.1": [
        {"same seed again": False, "another seed": False, "another song": False},
        {"same seed again": True, "another seed": False, "another song": True},
        {"same seed again": True},
        True,
    ],
    "00.2": [
        {"twice the steps": 1, "twice the dancers": 2, "twice the seconds": 2},
        {"twice the steps": 2, "twice the dancers": 1, "twice the seconds": 2},  # frame by frame
        {"twice the steps": 2, "twice the dancers": 2, "twice the seconds": 1},  # one at a time
        [2, 1, 1],
    ],
    "00.3": [
        song(beat=1 / 60),  # bpm / 60 the wrong way round
        song(beat=30.0),  # two beats where there is one
        song(other=22050),  # always the same rate
        song(last=0),  # does not stop
        song(last=2),  # stops a bar early
        song(every=4),  # one beat a bar
        song(every=2),
        song(off=0.25),  # a quarter of a beat later
        song(off=1),  # on the next beat
        song(click=0.9),  # as loud as the kick
        song(click=0.0),
        song(kick=0.3),
        song(kick=1.3),  # too loud for a loudspeaker
        song(lasts=0.9),  # dies away too slowly
        song_of_noise_under_it,
        song_in_columns,  # stereo
        lambda bpm, bars, rate: np.zeros(round(240 * bars / bpm * rate)),
        lambda bpm, bars, rate: song()(bpm, bars, rate)[::-1],
        lambda bpm, bars, rate: song()(120, bars, rate),  # always the same tempo
    ],
}
