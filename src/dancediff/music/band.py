r"""`Band`: players whose drums, voices and scale are drawn once per song.

Symbols (axes: n samples)
    mix    the sound so far, changed in place   (n,)
    step   a quarter of a beat; a bar has 16
"""

from collections.abc import Callable

import numpy as np

from dancediff.music import instruments
from dancediff.music.instruments import RATE

_SCALES = ([0, 2, 3, 5, 7, 8, 10], [0, 2, 4, 5, 7, 9, 11], [0, 3, 5, 7, 10], [0, 2, 4, 7, 9])
PROGRESSIONS = ([0, 5, 3, 4], [0, 3, 4, 3], [0, 2, 3, 4], [0, 0, 3, 4], [0, 5, 1, 4])


class Band:
    """Four players whose sounds are drawn once per song."""

    def __init__(self, rng: np.random.Generator, beat: float):
        self.rng, self.beat = rng, beat
        self.key = int(rng.integers(0, 12))
        self.scale = _SCALES[rng.integers(len(_SCALES))]
        self.swing = float(rng.choice([0, 0, 0.06, 0.14]))
        self.level = {k: float(10 ** (rng.uniform(lo, hi) / 20)) for k, (lo, hi) in _LEVELS.items()}
        hit = instruments.noise_hit
        self.drums = {
            "kick": instruments.kick(rng),
            "snare": instruments.snare(rng),
            "hat": hit(rng, rng.uniform(0.02, 0.12), rng.uniform(4500, 8500)),
            "shaker": hit(rng, rng.uniform(0.03, 0.09), rng.uniform(2500, 6000)),
        }
        self.voices = {k: instruments.voice(rng) for k in ("bass", "chord", "lead")}
        self.notes: dict[tuple, np.ndarray] = {}

    def write(self, label: str, rng: np.random.Generator) -> dict:
        """Material of one kind of section: drum grids of 16 steps, chords, a riff."""
        full = label == "chorus"
        sparse = label in ("intro", "bridge")
        kick = np.zeros(16)
        kick[[0, 4, 8, 12] if rng.random() < 0.6 or full else [0, 8]] = 1
        extra = rng.random(16) < (0.05 if sparse else 0.12)
        kick = np.maximum(kick, 0.7 * extra)
        snare = np.zeros(16)
        if not sparse:
            snare[[4, 12]] = 1
        hat = np.zeros(16)
        hat[:: int(rng.choice([1, 2, 2, 4]))] = 0.7
        hat[::4] = 1 if rng.random() < 0.6 else 0.4
        return {
            "kick": kick,
            "snare": snare,
            "hat": hat * (0.4 if sparse else 1),
            "shaker": (rng.random(16) < 0.5) * 0.6 * full,
            "chords": PROGRESSIONS[rng.integers(len(PROGRESSIONS))],
            "bass": rng.random(16) < 0.35,
            "lead": [(k, int(rng.integers(0, 8))) for k in range(16) if rng.random() < 0.3],
            "use": {
                "chord": bool(rng.random() < 0.85),
                "lead": bool(full or rng.random() < 0.5),
                "bass": bool(not sparse or rng.random() < 0.5),
            },
        }

    def play(self, mix: np.ndarray, part: dict, when: Callable, bar: int, end: float) -> None:
        """Add one bar, with step k at the time ``when(k)``; no drum begins after ``end``."""
        step = self.beat / 4
        for k in range(16):
            time = when(k + (self.swing * 2 if k % 2 else 0))
            if time >= end:
                break
            for name, sound in self.drums.items():
                if part[name][k] > 0:
                    add(mix, sound, time, self.level[name] * part[name][k])
        root = part["chords"][bar % 4]
        if part["use"]["chord"]:
            for third in (0, 2, 4):
                self.note(mix, "chord", root + third, 0, when(0), 4 * self.beat * 0.95)
        if part["use"]["bass"]:
            for k in np.flatnonzero(part["bass"] | (np.arange(16) == 0)).tolist():
                self.note(mix, "bass", root, -2, when(k), step * 1.8)
        if part["use"]["lead"]:
            for k, degree in part["lead"]:
                self.note(mix, "lead", root + degree, 1, when(k), step * 1.9)

    def note(self, mix, player: str, degree: int, octave: int, at: float, seconds: float) -> None:
        """Add a note of the scale to ``mix``."""
        turn, place = divmod(degree, len(self.scale))
        pitch = 60 + self.key + self.scale[place] + 12 * (turn + octave)
        key = (player, pitch, round(seconds, 3))
        if key not in self.notes:
            hz = 440 * 2 ** ((pitch - 69) / 12)
            self.notes[key] = self.voices[player](hz, seconds)
        add(mix, self.notes[key], at, self.level[player])


_LEVELS = {  # dB, softest and loudest a player may be
    "kick": (-6, 0), "snare": (-12, -2), "hat": (-26, -10), "shaker": (-28, -14),
    "bass": (-16, -4), "chord": (-26, -8), "lead": (-26, -7),
}  # fmt: skip


def add(mix: np.ndarray, sound: np.ndarray, at: float, level: float) -> None:
    """Add a sound to ``mix`` from the second ``at`` on, as far as it fits."""
    i = round(at * RATE)
    room = len(mix) - i
    if room > 0:
        mix[i : i + len(sound)] += level * sound[:room]
