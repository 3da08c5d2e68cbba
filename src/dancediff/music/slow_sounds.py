r"""Sounds of the parts of a song that have no beat: pads, noise that rises, a piano.

Symbols (axes: n samples)
    sec   time of a sample, seconds   (n,)
"""

import itertools
from collections.abc import Callable

import numpy as np
from scipy.signal import butter, sosfilt

from dancediff.music.instruments import RATE


def pad(rng: np.random.Generator) -> Callable[[float, float], np.ndarray]:
    """Draw a soft held sound without any attack; returns a function of pitch (Hz) and length (s).

    >>> tone = pad(np.random.default_rng(0))(220.0, 3.0)
    >>> bool(abs(tone[:2000]).max() < 0.3 * abs(tone).max())
    True
    """
    falloff, detune = rng.uniform(1.0, 2.2), rng.uniform(0.001, 0.008)
    wobble, depth = rng.uniform(0.1, 0.6), rng.uniform(0, 0.3)

    def sound(hz: float, seconds: float) -> np.ndarray:
        sec = np.arange(int(seconds * RATE)) / RATE
        wave = np.zeros(len(sec))
        for k in range(1, 9):
            if k * hz < RATE / 2.2:
                wave += k**-falloff * np.sin(2 * np.pi * hz * k * sec)
                wave += k**-falloff * np.sin(2 * np.pi * hz * k * (1 + detune) * sec + k)
        edge = min(2.0, seconds / 2)
        shape = np.minimum(1, np.minimum(sec, seconds - sec) / edge)
        shape = np.sin(np.pi / 2 * shape) ** 2
        return wave * shape * (1 + depth * np.sin(2 * np.pi * wobble * sec))

    return sound


def piano(rng: np.random.Generator) -> Callable[[float, float], np.ndarray]:
    """Draw a struck string; returns a function of pitch (Hz) and length (s)."""
    bright, decay = rng.uniform(0.8, 1.8), rng.uniform(0.6, 1.6)

    def sound(hz: float, seconds: float) -> np.ndarray:
        sec = np.arange(int(seconds * RATE)) / RATE
        wave = np.zeros(len(sec))
        for k in range(1, 11):
            pitch = hz * k * np.sqrt(1 + 4e-4 * k * k)  # a stiff string's partials are too high
            if pitch < RATE / 2.2:
                wave += k**-bright * np.sin(2 * np.pi * pitch * sec) * np.exp(-sec * (1 + 0.3 * k))
        attack = np.minimum(sec / 0.004, 1) * np.minimum((seconds - sec) / 0.02, 1)
        return wave * attack * np.exp(-sec / decay)

    return sound


def sweep(rng: np.random.Generator, seconds: float) -> np.ndarray:
    """Noise whose brightness rises or falls slowly, (n,).

    >>> sweep(np.random.default_rng(0), 2.0).shape
    (44100,)
    """
    n = int(seconds * RATE)
    edges = 100 * 2.0 ** np.arange(7)  # six octaves
    place = np.linspace(0, 5, n) if rng.random() < 0.7 else np.linspace(5, 0, n)
    out = np.zeros(n)
    for k, (low, high) in enumerate(itertools.pairwise(edges)):
        sos = butter(2, [low, high], "band", fs=RATE, output="sos")
        out += sosfilt(sos, rng.normal(size=n)) * np.exp(-0.5 * ((place - k) / 0.8) ** 2)
    return out * np.minimum(1, np.minimum(np.arange(n), np.arange(n)[::-1]) / RATE)
