r"""The players' sounds: drums, notes of a drawn timbre, and the room's echo.

Symbols (axes: n samples)
    rate   22,050 samples a second
    sec    time of a sample, seconds   (n,)
"""

from collections.abc import Callable

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

RATE = 22050


def kick(rng: np.random.Generator) -> np.ndarray:
    """A bass drum: a falling tone and perhaps a click."""
    sec = np.arange(int(rng.uniform(0.12, 0.35) * RATE)) / RATE
    low, drop = rng.uniform(42, 65), rng.uniform(60, 220)
    phase = 2 * np.pi * (low * sec + drop * 0.02 * (1 - np.exp(-sec / 0.02)))
    click = rng.uniform(0, 0.4) * np.exp(-sec / 0.003) * rng.normal(size=len(sec))
    return np.sin(phase) * np.exp(-sec / rng.uniform(0.06, 0.16)) + click


def snare(rng: np.random.Generator) -> np.ndarray:
    """A snare drum: a short tone under noise."""
    sec = np.arange(int(rng.uniform(0.1, 0.28) * RATE)) / RATE
    tone = np.sin(2 * np.pi * rng.uniform(160, 250) * sec) * np.exp(-sec / 0.05)
    noise = rng.normal(size=len(sec)) * np.exp(-sec / rng.uniform(0.03, 0.1))
    sos = butter(1, rng.uniform(500, 2500), "high", fs=RATE, output="sos")
    return rng.uniform(0.2, 0.8) * tone + 0.6 * sosfilt(sos, noise)


def noise_hit(rng: np.random.Generator, decay: float, cut: float) -> np.ndarray:
    """A hat or shaker: noise above ``cut`` Hz that dies away in ``decay`` seconds."""
    sec = np.arange(int(decay * 5 * RATE)) / RATE
    sos = butter(2, cut, "high", fs=RATE, output="sos")
    return sosfilt(sos, rng.normal(size=len(sec)) * np.exp(-sec / decay))


def voice(rng: np.random.Generator) -> Callable[[float, float], np.ndarray]:
    """Draw a timbre; returns a function of pitch (Hz) and length (s)."""
    kind = rng.choice(["additive", "fm", "pluck", "square"])
    partials = rng.uniform(0, 1, 12) * np.arange(1, 13) ** -rng.uniform(0.3, 1.8)
    ratio, index = float(rng.choice([0.5, 1, 2, 3, 3.5])), rng.uniform(0.5, 6)
    attack, decay = rng.uniform(0.002, 0.06), rng.uniform(0.1, 1.5)
    duty, detune = rng.uniform(0.2, 0.5), rng.uniform(0, 0.006)

    def sound(hz: float, seconds: float) -> np.ndarray:
        sec = np.arange(int(seconds * RATE)) / RATE
        shape = np.minimum(sec / attack, 1) * np.exp(-sec / decay)
        shape *= np.minimum((seconds - sec) / 0.01, 1)
        if kind == "fm":
            wave = np.sin(
                2 * np.pi * hz * sec + index * shape * np.sin(2 * np.pi * hz * ratio * sec)
            )
        elif kind == "square":
            saw = ((hz * sec) % 1 < duty) - duty + (((hz * (1 + detune) * sec) % 1 < duty) - duty)
            wave = lfilter([0.3], [1, -0.7], saw.astype(float))
        else:
            live = [k for k in range(1, 13) if k * hz < RATE / 2.2]
            waves = (partials[k - 1] * np.sin(2 * np.pi * hz * k * sec) for k in live)
            if kind == "pluck":  # high partials die first
                waves = (wave * np.exp(-sec * 1.5 * k) for wave, k in zip(waves, live, strict=True))
            wave = sum(waves)
            wave = wave / max(partials[: len(live)].sum(), 1e-3)
        return wave * shape

    return sound


def echo(x: np.ndarray, delay: int, back: float) -> np.ndarray:
    r"""$y_i = x_i + b\, y_{i-d}$, a delay at a time: `lfilter` would multiply d zeros a sample.

    >>> echo(np.array([1.0, 0, 0, 0, 0]), 2, 0.5).tolist()
    [1.0, 0.0, 0.5, 0.0, 0.25]
    """
    y = x.copy()
    for at in range(delay, len(y), delay):
        part = y[at : at + delay]
        part += back * y[at - delay : at - delay + len(part)]
    return y
