r"""Seeded songs with known beats: drums, bass, chords and a lead, in sections.

`synth_song` keeps one tempo; `synth_on_beats` puts its beats wherever they are wanted.

Read first: notebook 02. Everything drawn here is synthetic; real songs are only similar.

Symbols
    rate   22,050 samples a second
    beat   one quarter note; a bar has four, a section four or eight bars
    when   time of a step (a quarter of a beat) of a bar, in seconds
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from dancediff.music import instruments
from dancediff.music.instruments import RATE
from dancediff.music.song import Music

_SCALES = ([0, 2, 3, 5, 7, 8, 10], [0, 2, 4, 5, 7, 9, 11], [0, 3, 5, 7, 10], [0, 2, 4, 7, 9])
_PROGRESSIONS = ([0, 5, 3, 4], [0, 3, 4, 3], [0, 2, 3, 4], [0, 0, 3, 4], [0, 5, 1, 4])


@dataclass(frozen=True)
class SongTruth:
    """What the synthesiser knows: tempo (BPM), beats and downbeats (s), (start, stop, label)."""

    tempo: float
    beats: np.ndarray
    downbeats: np.ndarray
    sections: list[tuple[float, float, str]]
    seed: int


def synth_song(seed: int, *, seconds: float = 30.0, tempo: float | None = None):
    """Render a song; the same seed gives the same samples.

    Raises: ValueError when seconds is not positive or the tempo lies outside 60..200 BPM.

    >>> song, truth = synth_song(3, seconds=4.0, tempo=120)
    >>> round(song.duration, 3), truth.beats[:3].round(2).tolist()[0] < 0.5
    (4.0, True)
    """
    rng = np.random.default_rng(seed)
    tempo = float(rng.uniform(84, 146)) if tempo is None else float(tempo)
    if not seconds > 0:
        raise ValueError(f"seconds={seconds} must be positive")
    if not 60 <= tempo <= 200:
        raise ValueError(f"tempo={tempo} is not in 60..200 beats a minute")
    beat = 60 / tempo
    start = float(rng.uniform(0, beat * 0.9))
    beats = np.arange(start, seconds, beat)
    band = _Band(rng, beat)
    sections = _sections(rng, seconds, start, beat)
    song = _perform(band, sections, seconds, 4 * beat, lambda at, k: at + k * (beat / 4))
    truth = SongTruth(tempo, beats, beats[::4], sections, int(seed))
    return Music(song, RATE, f"synth-{seed}"), truth


def synth_on_beats(beats, seed: int, *, seconds: float):
    """Render a song whose beats fall on given times, however uneven.

    Beyond the first and the last time the beats go on evenly. Everything else is drawn as for
    `synth_song`: the same seed gives the same sound and another one another band.

    Shapes: beats (k,) seconds, increasing -> Music of ``seconds``, SongTruth.
    Raises: ValueError when seconds is not positive, or when beats are fewer than two, not
    increasing, or closer than 0.2 or farther than 2 seconds.

    >>> song, truth = synth_on_beats([0.4, 1.0, 1.5], 3, seconds=3.0)
    >>> round(song.duration, 3), truth.beats.round(2).tolist()
    (3.0, [0.4, 1.0, 1.5, 2.0, 2.5])
    """
    if not seconds > 0:
        raise ValueError(f"seconds={seconds} must be positive")
    grid = _carry_on(beats, seconds)
    inside = grid[grid < seconds]
    rng, beat = np.random.default_rng(seed), float(np.median(np.diff(grid)))
    band = _Band(rng, beat)
    sections = _sections(rng, len(inside), 0, 1)  # counted in beats

    def when(at: float, k: float = 0) -> float:
        return float(np.interp(at + k / 4, np.arange(len(grid)), grid))

    song = _perform(band, sections, seconds, 4, when)
    timed = [(when(begin), min(when(end), seconds), label) for begin, end, label in sections]
    truth = SongTruth(60 / beat, inside, inside[::4], timed, int(seed))
    return Music(song, RATE, f"synth-{seed}"), truth


def _carry_on(beats, seconds: float) -> np.ndarray:
    """Given beats, and even ones before them back to 0 and after them to a bar past the end."""
    beats = np.asarray(beats, dtype=np.float64)
    if beats.ndim != 1 or len(beats) < 2 or not np.isfinite(beats).all() or beats[0] < 0:
        raise ValueError("beats must be at least 2 times in seconds, from 0 on")
    gaps = np.diff(beats)
    if gaps.min() < 0.2 or gaps.max() > 2:
        raise ValueError(
            f"beats are {gaps.min():.2f} to {gaps.max():.2f} s apart; allowed are 0.2 to 2"
        )
    before = np.arange(beats[0] - gaps[0], 0, -gaps[0])[::-1]
    missing = max(0, int(np.ceil((seconds - beats[-1]) / gaps[-1]))) + 5
    return np.concatenate([before, beats, beats[-1] + gaps[-1] * np.arange(1, missing + 1)])


def _perform(band: "_Band", sections, seconds: float, bar: float, when: Callable) -> np.ndarray:
    """The sound of a song; ``when(at, k)``: when step k of the bar that begins at ``at`` comes."""
    mix = np.zeros(int(seconds * RATE) + RATE)
    material: dict[str, dict] = {}
    for begin, end, label in sections:
        part = material.setdefault(label, band.write(label, band.rng))
        for k in range(int(np.ceil((end - begin) / bar - 1e-6))):
            band.play(mix, part, partial(when, begin + k * bar), k, when(end, 0))
    return _master(mix[: round(seconds * RATE)], band.rng)


def _sections(rng, seconds, start, beat):
    labels = ["intro", "verse", "chorus", "verse", "chorus", "bridge", "chorus"]
    labels = labels[int(rng.integers(0, 2)) :]
    out, at, k = [], start, 0
    while at < seconds:
        label = labels[k % len(labels)]
        bars = 2 if label == "intro" else int(rng.choice([4, 4, 8]))
        out.append((at, min(at + bars * 4 * beat, seconds), label))
        at += bars * 4 * beat
        k += 1
    return out


def _master(mix: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Tone, a short room, saturation, level: so that no two songs share a spectrum."""
    tilt = rng.uniform(-0.55, 0.45)
    mix = lfilter([1.0, tilt], [1.0], mix)
    if rng.random() < 0.6:
        delay = int(rng.uniform(0.011, 0.05) * RATE)
        back = rng.uniform(0.1, 0.45)
        mix = mix + rng.uniform(0.1, 0.4) * instruments.echo(mix, delay, back)
    if rng.random() < 0.5:
        low, high = rng.uniform(20, 90), rng.uniform(4500, 10500)
        mix = sosfilt(butter(2, [low, high], "band", fs=RATE, output="sos"), mix)
    drive = rng.uniform(0.6, 3.5)
    mix = np.tanh(drive * mix / (np.abs(mix).max() + 1e-9))
    hiss = rng.normal(size=len(mix)) * 10 ** rng.uniform(-4.5, -2.3)
    mix = mix + hiss
    return (mix / np.abs(mix).max() * rng.uniform(0.3, 0.95)).astype(np.float32)


class _Band:
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
            "chords": _PROGRESSIONS[rng.integers(len(_PROGRESSIONS))],
            "bass": rng.random(16) < 0.35,
            "lead": [(k, int(rng.integers(0, 8))) for k in range(16) if rng.random() < 0.3],
            "use": {
                "chord": bool(rng.random() < 0.85),
                "lead": bool(full or rng.random() < 0.5),
                "bass": bool(not sparse or rng.random() < 0.5),
            },
        }

    def play(self, mix: np.ndarray, part: dict, when: Callable, bar: int, end: float) -> None:
        """Add one bar, with step k at the time ``when(k)``; nothing begins after ``end``."""
        step = self.beat / 4
        for k in range(16):
            time = when(k + (self.swing * 2 if k % 2 else 0))
            if time >= end:
                break
            for name, sound in self.drums.items():
                if part[name][k] > 0:
                    _add(mix, sound, time, self.level[name] * part[name][k])
        root = part["chords"][bar % 4]
        if part["use"]["chord"]:
            for third in (0, 2, 4):
                self._note(mix, "chord", root + third, 0, when(0), 4 * self.beat * 0.95)
        if part["use"]["bass"]:
            for k in np.flatnonzero(part["bass"] | (np.arange(16) == 0)).tolist():
                self._note(mix, "bass", root, -2, when(k), step * 1.8)
        if part["use"]["lead"]:
            for k, degree in part["lead"]:
                self._note(mix, "lead", root + degree, 1, when(k), step * 1.9)

    def _note(self, mix, player, degree, octave, at, seconds) -> None:
        turn, place = divmod(degree, len(self.scale))
        pitch = 60 + self.key + self.scale[place] + 12 * (turn + octave)
        key = (player, pitch, round(seconds, 3))
        if key not in self.notes:
            hz = 440 * 2 ** ((pitch - 69) / 12)
            self.notes[key] = self.voices[player](hz, seconds)
        _add(mix, self.notes[key], at, self.level[player])


_LEVELS = {  # dB, softest and loudest a player may be
    "kick": (-6, 0), "snare": (-12, -2), "hat": (-26, -10), "shaker": (-28, -14),
    "bass": (-16, -4), "chord": (-26, -8), "lead": (-26, -7),
}  # fmt: skip


def _add(mix: np.ndarray, sound: np.ndarray, at: float, level: float) -> None:
    i = round(at * RATE)
    room = len(mix) - i
    if room > 0:
        mix[i : i + len(sound)] += level * sound[:room]
