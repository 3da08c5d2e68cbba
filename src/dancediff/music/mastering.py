r"""From a mix to the sound of a recording: tone, a short room, saturation, level.

Symbols (axes: n samples)
    mix   the players' sum   (n,)
"""

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from dancediff.music import instruments
from dancediff.music.instruments import RATE


def colour(mix: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Tone and a short room, drawn: no two songs share a spectrum; (n,) -> (n,)."""
    tilt = rng.uniform(-0.55, 0.45)
    mix = lfilter([1.0, tilt], [1.0], mix)
    if rng.random() < 0.6:
        delay = int(rng.uniform(0.011, 0.05) * RATE)
        back = rng.uniform(0.1, 0.45)
        mix = mix + rng.uniform(0.1, 0.4) * instruments.echo(mix, delay, back)
    if rng.random() < 0.5:
        low, high = rng.uniform(20, 90), rng.uniform(4500, 10500)
        mix = sosfilt(butter(2, [low, high], "band", fs=RATE, output="sos"), mix)
    return mix


def master(mix: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Colour, saturation, hiss and level, all drawn, (n,) -> (n,) float32 in [-1, 1]."""
    mix = colour(mix, rng)
    drive = rng.uniform(0.6, 3.5)
    mix = np.tanh(drive * mix / (np.abs(mix).max() + 1e-9))
    hiss = rng.normal(size=len(mix)) * 10 ** rng.uniform(-4.5, -2.3)
    mix = mix + hiss
    return (mix / np.abs(mix).max() * rng.uniform(0.3, 0.95)).astype(np.float32)
