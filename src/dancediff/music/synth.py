r"""Seeded songs with known beats: drums, bass, chords and a lead, in sections.

`synth_song` keeps one tempo; `synth_on_beats` puts its beats wherever they are wanted;
`dancediff.music.varied.synth_varied_song` does what real songs do.

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

from dancediff.music.band import Band
from dancediff.music.instruments import RATE
from dancediff.music.mastering import master
from dancediff.music.song import Music


@dataclass(frozen=True)
class SongTruth:
    """What the synthesiser knows: tempo (BPM), beats and downbeats (s), (start, stop, label).

    There are no beats where the music has none; ``meter`` is how many beats a bar has.
    """

    tempo: float
    beats: np.ndarray
    downbeats: np.ndarray
    sections: list[tuple[float, float, str]]
    seed: int
    meter: int = 4


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
    band = Band(rng, beat)
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
    band = Band(rng, beat)
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


def _perform(band: Band, sections, seconds: float, bar: float, when: Callable) -> np.ndarray:
    """The sound of a song; ``when(at, k)``: when step k of the bar that begins at ``at`` comes."""
    mix = np.zeros(int(seconds * RATE) + RATE)
    material: dict[str, dict] = {}
    for begin, end, label in sections:
        part = material.setdefault(label, band.write(label, band.rng))
        for k in range(int(np.ceil((end - begin) / bar - 1e-6))):
            band.play(mix, part, partial(when, begin + k * bar), k, when(end, 0))
    return master(mix[: round(seconds * RATE)], band.rng)


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
