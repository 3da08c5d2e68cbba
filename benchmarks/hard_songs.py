r"""Songs with hard places, for benchmarks/any_song.py, and where they have a beat.

Recorded: excerpts of the LMMS demo songs (CC BY-SA 3.0) and a CC0 drum loop, of a data folder that
has ``music`` and ``loops_cc0``. Synthetic: what no recording there has. It is played by instruments
of this file, which no training hears.

Symbols (axes: k beats)
    beats   times of the beats, seconds, none where the music has none: of recordings those that
            the package hears, of synthetic songs those that were played                    (k,)
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfilt

from dancediff.music.song import Music

SECONDS, RATE = 40.0, 22050
CHORDS = ([57, 60, 64], [53, 57, 60], [48, 55, 64], [55, 59, 62])  # A minor, F, C, G


@dataclass(frozen=True, eq=False)
class HardSong:
    """A song to dance to, what is hard about it, and its beats in seconds (k,)."""

    name: str
    place: str
    kind: str  # "recorded" or "synthetic"
    music: Music = field(repr=False)
    beats: np.ndarray = field(repr=False)


def hard_songs(data: Path) -> list[HardSong]:
    """All of them, 40 s each; ``data`` is the folder with ``music`` and ``loops_cc0``.

    Raises: ValueError naming the file that is not there.
    """

    def excerpt(stem: str, start: float) -> Music:
        return Music.load(data / "music" / f"{stem}.ogg").slice(start, start + SECONDS)

    loop = Music.load(data / "loops_cc0" / "loop_breakbeat.flac")
    recorded: dict[str, tuple[str, Music]] = {
        "Zen, start": ("6 s without a beat", excerpt("Impulslogik-Zen", 0)),
        "TwilightArea, start": (
            "5 s without a beat",
            excerpt("CapDan-TwilightArea-OriginalByAlf42red", 0),
        ),
        "Zen, 118 s": ("a break of 15 s", excerpt("Impulslogik-Zen", 118)),
        "breakbeat": ("drums only", repeated(loop, SECONDS)),
        "InnerRecreation": ("very quiet", louder(excerpt("Settel-InnerRecreation", 0), -40)),
        "ReggaeTry": ("very loud, clipped", louder(excerpt("CapDan-ReggaeTry", 2), 15)),
    }
    songs = [
        HardSong(name, place, "recorded", music, music.beats())
        for name, (place, music) in recorded.items()
    ]
    return [*songs, tempo_change(), waltz(), rubato()]


def louder(music: Music, decibels: float) -> Music:
    """At another level; samples beyond 1 are clipped, as a bad master has it."""
    return Music(np.clip(music.audio[:] * 10 ** (decibels / 20), -1, 1), music.rate, music.name)


def repeated(music: Music, seconds: float) -> Music:
    """A loop, again and again."""
    times = int(np.ceil(seconds / music.duration))
    whole = np.tile(music.audio[:], (times, 1))[: round(seconds * music.rate)]
    return Music(whole, music.rate, music.name)


def tempo_change(slow: float = 96, fast: float = 136) -> HardSong:
    """A band that plays 20 s at one tempo and goes on at another; synthetic."""
    first = np.arange(0.4, SECONDS / 2, 60 / slow)
    beats = np.concatenate([first, np.arange(first[-1] + 60 / fast, SECONDS, 60 / fast)])
    place = f"{slow:g}, from 20 s on {fast:g} beats a minute"
    return HardSong("band", place, "synthetic", played(beats, bar=4, seed=1), beats)


def waltz(tempo: float = 138) -> HardSong:
    """Bass, chord, chord; synthetic."""
    beats = np.arange(0.3, SECONDS, 60 / tempo)
    return HardSong("waltz", "3/4", "synthetic", played(beats, bar=3, seed=2), beats)


def rubato() -> HardSong:
    """A piano alone whose notes come when they like: no beat to step on; synthetic."""
    rng = np.random.default_rng(3)
    mix, at, k = np.zeros(round(SECONDS * RATE)), 0.5, 0
    while at < SECONDS - 1:
        chord = CHORDS[k // 6 % len(CHORDS)]
        note = chord[0] - 12 if k % 6 == 0 else int(rng.choice(chord)) + 12 * int(rng.integers(2))
        add(mix, piano(note, rng.uniform(0.25, 1.0)), at)
        breath = 1 + 0.6 * np.sin(2 * np.pi * at / 9)  # phrases hurry and linger
        at += float(rng.uniform(0.25, 0.6)) * breath + (0.8 if k % 6 == 5 else 0)
        k += 1
    return HardSong("piano", "rubato", "synthetic", mastered(mix, rng), np.zeros(0))


def played(beats: np.ndarray, *, bar: int, seed: int) -> Music:
    """A piano with bass on the first beat of a bar and chords on the others, and light drums."""
    rng = np.random.default_rng(seed)
    mix = np.zeros(round(SECONDS * RATE))
    for k, at in enumerate(beats):
        chord = CHORDS[k // bar % len(CHORDS)]
        for note in [chord[0] - 24] if k % bar == 0 else chord:
            add(mix, piano(note, 0.8 if k % bar == 0 else 0.4), at)
        add(mix, drum(rng, low=k % bar == 0), at)
    return mastered(mix, rng)


def piano(note: int, strength: float) -> np.ndarray:
    """A struck string: stronger strokes are brighter, high partials die first."""
    t = np.arange(int(2.5 * RATE)) / RATE
    hz = 440 * 2 ** ((note - 69) / 12)
    y = np.zeros(len(t))
    for k in range(1, 1 + min(10, int(RATE / 2.2 / hz))):
        stretched = k * np.sqrt(1 + 4e-4 * k**2)
        y += strength ** (k / 3) / k * np.sin(2 * np.pi * hz * stretched * t) * np.exp(-t * k**0.7)
    return strength * y * np.minimum(t / 0.004, 1)


def drum(rng: np.random.Generator, *, low: bool) -> np.ndarray:
    """A bass drum, or a brush over a snare."""
    t = np.arange(int(0.25 * RATE)) / RATE
    if low:
        return 1.2 * np.sin(2 * np.pi * (52 * t + 2 * (1 - np.exp(-t / 0.02)))) * np.exp(-t / 0.08)
    sos = butter(2, 2500, "high", fs=RATE, output="sos")
    return 0.25 * sosfilt(sos, rng.normal(size=len(t)) * np.exp(-t / 0.05))


def add(mix: np.ndarray, sound: np.ndarray, at: float) -> None:
    """Add a sound from a time on, as much of it as fits."""
    first = round(at * RATE)
    room = mix[first : first + len(sound)]
    room += sound[: len(room)]


def mastered(mix: np.ndarray, rng: np.random.Generator) -> Music:
    """With a little hiss, at a usual level."""
    hissing = mix / np.abs(mix).max() + 1e-4 * rng.normal(size=len(mix))
    return Music((0.7 * hissing).astype(np.float32), RATE)


def liveliest(music: Music, seconds: float, loudness: Callable[[Music], np.ndarray]) -> float:
    """Where the stretch begins whose loudness changes most, in whole fives of seconds.

    ``loudness`` gives a number for each two seconds of a song.
    """
    curve, size = loudness(music), round(seconds / 2)
    starts = np.arange(0, max(1, int((music.duration - seconds) // 5) + 1)) * 5
    spread = [np.std(curve[int(s // 2) : int(s // 2) + size]) for s in starts]
    return float(starts[int(np.argmax(spread))])
