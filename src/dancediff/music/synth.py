r"""Seeded songs with known beats: drums, bass, chords and a lead, in sections.

Read first: notebook 02. Everything drawn here is synthetic; real songs are only similar.

Symbols
    rate   22,050 samples a second
    beat   one quarter note; a bar has four, a section four or eight bars
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from dancediff.music.song import Music

RATE = 22050
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
    mix = np.zeros(int(seconds * RATE) + RATE)
    sections = _sections(rng, seconds, start, beat)
    material: dict[str, dict] = {}
    for begin, end, label in sections:
        part = material.setdefault(label, band.write(label, rng))
        bars = int(np.ceil((end - begin) / (4 * beat) - 1e-6))
        for bar in range(bars):
            at = begin + bar * 4 * beat
            band.play(mix, part, at, bar, end)
    song = _master(mix[: round(seconds * RATE)], rng)
    return (
        Music(song, RATE, f"synth-{seed}"),
        SongTruth(tempo, beats, beats[::4], sections, int(seed)),
    )


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
        comb = np.zeros(delay + 1)
        comb[0], comb[-1] = 1, -rng.uniform(0.1, 0.45)
        mix = mix + rng.uniform(0.1, 0.4) * lfilter([1.0], comb, mix)
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
        self.kick = _kick(rng)
        self.snare = _snare(rng)
        self.hat = _noise_hit(rng, rng.uniform(0.02, 0.12), rng.uniform(4500, 8500))
        self.shaker = _noise_hit(rng, rng.uniform(0.03, 0.09), rng.uniform(2500, 6000))
        self.voices = {k: _voice(rng) for k in ("bass", "chord", "lead")}
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

    def play(self, mix: np.ndarray, part: dict, at: float, bar: int, end: float) -> None:
        """Add one bar at time ``at``; nothing begins after ``end``."""
        step = self.beat / 4
        for k in range(16):
            time = at + (k + (self.swing * 2 if k % 2 else 0)) * step
            if time >= end:
                break
            for name, sound in (
                ("kick", self.kick),
                ("snare", self.snare),
                ("hat", self.hat),
                ("shaker", self.shaker),
            ):
                if part[name][k] > 0:
                    _add(mix, sound, time, self.level[name] * part[name][k])
        root = part["chords"][bar % 4]
        if part["use"]["chord"]:
            for third in (0, 2, 4):
                self._note(mix, "chord", root + third, 0, at, 4 * self.beat * 0.95)
        if part["use"]["bass"]:
            for k in np.flatnonzero(part["bass"] | (np.arange(16) == 0)):
                self._note(mix, "bass", root, -2, at + k * step, step * 1.8)
        if part["use"]["lead"]:
            for k, degree in part["lead"]:
                self._note(mix, "lead", root + degree, 1, at + k * step, step * 1.9)

    def _note(self, mix, player, degree, octave, at, seconds) -> None:
        turn, place = divmod(degree, len(self.scale))
        pitch = 60 + self.key + self.scale[place] + 12 * (turn + octave)
        key = (player, pitch, round(seconds, 3))
        if key not in self.notes:
            hz = 440 * 2 ** ((pitch - 69) / 12)
            self.notes[key] = self.voices[player](hz, seconds)
        _add(mix, self.notes[key], at, self.level[player])


_LEVELS = {  # dB, loudest and softest a player may be
    "kick": (-6, 0),
    "snare": (-12, -2),
    "hat": (-26, -10),
    "shaker": (-28, -14),
    "bass": (-16, -4),
    "chord": (-26, -8),
    "lead": (-26, -7),
}


def _add(mix: np.ndarray, sound: np.ndarray, at: float, level: float) -> None:
    i = round(at * RATE)
    room = len(mix) - i
    if room > 0:
        mix[i : i + len(sound)] += level * sound[:room]


def _kick(rng) -> np.ndarray:
    t = np.arange(int(rng.uniform(0.12, 0.35) * RATE)) / RATE
    low, drop = rng.uniform(42, 65), rng.uniform(60, 220)
    phase = 2 * np.pi * (low * t + drop * 0.02 * (1 - np.exp(-t / 0.02)))
    click = rng.uniform(0, 0.4) * np.exp(-t / 0.003) * rng.normal(size=len(t))
    return np.sin(phase) * np.exp(-t / rng.uniform(0.06, 0.16)) + click


def _snare(rng) -> np.ndarray:
    t = np.arange(int(rng.uniform(0.1, 0.28) * RATE)) / RATE
    tone = np.sin(2 * np.pi * rng.uniform(160, 250) * t) * np.exp(-t / 0.05)
    noise = rng.normal(size=len(t)) * np.exp(-t / rng.uniform(0.03, 0.1))
    sos = butter(1, rng.uniform(500, 2500), "high", fs=RATE, output="sos")
    return rng.uniform(0.2, 0.8) * tone + 0.6 * sosfilt(sos, noise)


def _noise_hit(rng, decay: float, cut: float) -> np.ndarray:
    t = np.arange(int(decay * 5 * RATE)) / RATE
    sos = butter(2, cut, "high", fs=RATE, output="sos")
    return sosfilt(sos, rng.normal(size=len(t)) * np.exp(-t / decay))


def _voice(rng):
    """Draw a timbre; returns a function of pitch (Hz) and length (s)."""
    kind = rng.choice(["additive", "fm", "pluck", "square"])
    partials = rng.uniform(0, 1, 12) * np.arange(1, 13) ** -rng.uniform(0.3, 1.8)
    ratio, index = float(rng.choice([0.5, 1, 2, 3, 3.5])), rng.uniform(0.5, 6)
    attack, decay = rng.uniform(0.002, 0.06), rng.uniform(0.1, 1.5)
    duty, detune = rng.uniform(0.2, 0.5), rng.uniform(0, 0.006)

    def sound(hz: float, seconds: float) -> np.ndarray:
        t = np.arange(int(seconds * RATE)) / RATE
        shape = np.minimum(t / attack, 1) * np.exp(-t / decay)
        shape *= np.minimum((seconds - t) / 0.01, 1)
        if kind == "fm":
            wave = np.sin(2 * np.pi * hz * t + index * shape * np.sin(2 * np.pi * hz * ratio * t))
        elif kind == "square":
            saw = ((hz * t) % 1 < duty) - duty + (((hz * (1 + detune) * t) % 1 < duty) - duty)
            wave = lfilter([0.3], [1, -0.7], saw.astype(float))
        else:
            live = [k for k in range(1, 13) if k * hz < RATE / 2.2]
            fade = 1.5 if kind == "pluck" else 0.0
            wave = sum(
                partials[k - 1] * np.sin(2 * np.pi * hz * k * t) * np.exp(-t * fade * k)
                for k in live
            )
            wave = wave / max(partials[: len(live)].sum(), 1e-3)
        return wave * shape

    return sound
