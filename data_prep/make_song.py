"""Arrange the packaged song from CC0 loops (Sonic Pi's samples) and parts of our own.

    python data_prep/make_song.py FOLDER_WITH_LOOPS src/dancediff/assets/songs

Writes studio_floor.ogg and studio_floor.json (true tempo, beats and sections).
"""

import json
import sys
from pathlib import Path

import librosa
import numpy as np

from dancediff.atomic import write_text
from dancediff.music import instruments
from dancediff.music.song import Music

RATE, SOUND = 32000, 22050
BPM, START = 120.0, 0.25
BEAT = 60 / BPM
PLAN = [  # label, bars, loops with their level, drums
    ("intro", 2, {"safari": 0.5}, "h"),
    ("A", 4, {"garzul": 0.55}, "kh"),
    ("B", 4, {"mika": 0.8, "safari": 0.3}, "kshb"),
    ("A'", 4, {"garzul": 0.5, "3d_printer": 0.45}, "kshb"),
    ("end", 1, {"safari": 0.4}, "kh"),
]


def loop(folder: Path, name: str) -> np.ndarray:
    """A loop at 32 kHz, exactly 16 beats long, stereo."""
    audio = Music.load(folder / f"loop_{name}.flac")
    y = librosa.resample(audio.audio.T, orig_sr=audio.rate, target_sr=RATE)
    goal = round(16 * BEAT * RATE)
    if abs(y.shape[1] - goal) > 200:
        y = librosa.effects.time_stretch(y, rate=y.shape[1] / goal)
    y = librosa.util.fix_length(y, size=goal, axis=1).T
    fade = np.minimum(1, np.minimum(np.arange(goal), np.arange(goal)[::-1]) / 400)  # no clicks
    return y * fade[:, None] / (np.abs(y).max() + 1e-9)


def bass(hz: float, beats: float) -> np.ndarray:
    """A round bass note."""
    t = np.arange(round(beats * BEAT * RATE)) / RATE
    tone = np.sin(2 * np.pi * hz * t) + 0.3 * np.sin(4 * np.pi * hz * t)
    return tone * np.minimum(t / 0.005, 1) * np.minimum((t[-1] - t) / 0.02, 1) * np.exp(-t / 0.4)


def main(folder: Path, out: Path) -> None:
    """Mix the plan and write the song with its truth."""
    rng = np.random.default_rng(7)
    up = lambda y: librosa.resample(y, orig_sr=SOUND, target_sr=RATE)  # noqa: E731
    kick, snare = up(instruments.kick(rng)), up(instruments.snare(rng))
    hat = up(instruments.noise_hit(rng, 0.03, 6500))
    bars = sum(n for _, n, _, _ in PLAN)
    mix = np.zeros((round((START + bars * 4 * BEAT + 0.8) * RATE), 2))
    sections, at = [], START

    def add(sound: np.ndarray, time: float, level: float) -> None:
        i = round(time * RATE)
        part = sound[: len(mix) - i]
        mix[i : i + len(part)] += level * (part if part.ndim == 2 else part[:, None])

    for label, count, loops, drums in PLAN:
        length = count * 4 * BEAT
        sections.append([round(at, 4), round(at + length, 4), label])
        for name, level in loops.items():
            add(loop(folder, name)[: round(length * RATE)], at, level)
        for beat in range(count * 4):
            now = at + beat * BEAT
            if "k" in drums:
                add(kick, now, 0.9)
            if "s" in drums and beat % 2:
                add(snare, now, 0.4)
            add(hat, now + BEAT / 2, 0.12)
            if "h" in drums:
                add(hat, now, 0.16)
            if "b" in drums:
                note = [55.0, 55.0, 65.41, 49.0][(beat // 4) % 4]
                add(bass(note, 0.9), now, 0.5)
        at += length
    fade = np.minimum(1, np.arange(len(mix))[::-1] / (0.8 * RATE))
    mix = np.tanh(1.1 * mix * fade[:, None] / np.abs(mix).max())
    song = Music((0.9 * mix / np.abs(mix).max()).astype(np.float32), RATE)
    song.save(out / "studio_floor.ogg")
    truth = {
        "tempo": BPM,
        "beats": [round(START + k * BEAT, 4) for k in range(bars * 4)],
        "sections": sections,
        "licence": "CC0-1.0",
    }
    write_text(out / "studio_floor.json", json.dumps(truth) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
