"""Folders of short dances as `dancediff generate` writes them, and their songs."""

import numpy as np

from dancediff.data.choreographer import choreograph
from dancediff.music.song import Music

SECONDS = 2.0
RATE = 8000


def hum(name: str, seconds: float = SECONDS) -> Music:
    t = np.arange(round(seconds * RATE)) / RATE
    return Music((0.3 * np.sin(2 * np.pi * 220 * t) * (t % 0.5 < 0.1))[:, None], RATE, name)


def dance(seed: int, *, dancers: int = 2, seconds: float = SECONDS):
    beats = np.arange(0.2, seconds, 0.5)
    return choreograph(beats, dancers=dancers, seed=seed, seconds=seconds)[0]


def write_dances(folder, songs, *, first_seed: int = 0, **how):
    """One dance a song, each in a folder of its song's name."""
    for k, name in enumerate(songs):
        (folder / name).mkdir(parents=True)
        dance(first_seed + k, **how).save(folder / name / "dance.npz")
    return folder
