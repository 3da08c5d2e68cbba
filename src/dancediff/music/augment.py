r"""Other versions of a song for training: as played elsewhere, faster, through a phone, in a hall.

Read first: notebook 02.

`augment_song` changes sound before features are taken, and says where its beats have gone.

Symbols (axes: n samples)
    y      mono sound at 22,050 Hz                      (n,)
    speed  how many times as fast the new version is
    rng    where all draws come from
"""

import io
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, oaconvolve, sosfilt

from dancediff.music.instruments import RATE
from dancediff.music.librosa_import import import_librosa
from dancediff.music.song import SILENT, Music

SHARES = {  # of versions in which a step is taken; each is drawn on its own
    "crop": 0.25,
    "tempo": 0.6,
    "pitch": 0.5,
    "room": 0.3,
    "filter": 0.4,
    "shelf": 0.4,
    "level": 0.3,
    "compression": 0.3,
    "noise": 0.35,
    "codec": 0.3,
}
SHORTEST_CROP = 20.0  # seconds that are left of a song at least; one under twice that is not cut
_FASTER, _SEMITONES = 0.12, 3  # largest change of tempo (a share) and of pitch


@dataclass(frozen=True)
class Change:
    """What became of a song: the part from ``start`` seconds on, ``speed`` times as fast.

    ``steps`` are those of `SHARES` that were taken.

    >>> Change(10.0, 2.0, ()).times([8.0, 10.0, 11.0, 12.0], seconds=0.9).tolist()
    [0.0, 0.5]
    """

    start: float
    speed: float
    steps: tuple[str, ...]

    def times(self, beats, seconds: float) -> np.ndarray:
        """Where times of the song, such as beats, lie in the version that lasts ``seconds``."""
        moved = (np.asarray(beats, dtype=np.float64) - self.start) / self.speed
        return moved[(moved >= 0) & (moved < seconds)]


def augment_song(song: Music, rng: np.random.Generator) -> tuple[Music, Change]:
    """Draw another version of a song, mono at 22,050 Hz; steps and strengths come from ``rng``.

    Raises: ValueError when the song is silent.

    >>> tone = Music(np.sin(np.arange(22050 * 6) * 0.05).astype(np.float32), 22050)
    >>> version, change = augment_song(tone, np.random.default_rng(1))
    >>> version.rate, abs(version.duration - 6 / change.speed) < 0.1
    (22050, True)
    """
    y = song.mono(RATE)
    if song.is_silent:
        raise ValueError(f"song {song.name!r} is silent")
    steps = [name for name, share in SHARES.items() if rng.random() < share]
    start = 0.0
    if len(y) <= 2 * SHORTEST_CROP * RATE:
        steps = [name for name in steps if name != "crop"]
    if "crop" in steps:
        start = float(rng.uniform(0, len(y) / RATE - SHORTEST_CROP))
        y = y[round(start * RATE) :]
    speed = 1 + float(rng.uniform(-_FASTER, _FASTER)) if "tempo" in steps else 1.0
    semitones = float(rng.uniform(-_SEMITONES, _SEMITONES)) if "pitch" in steps else 0.0
    y = faster_and_higher(y, speed, semitones)
    for name, change in _STEPS.items():
        if name in steps:
            y = change(y / (np.abs(y).max() + 1e-9), rng)
    y = (0.9 * y / (np.abs(y).max() + SILENT)).astype(np.float32)
    return Music(y, RATE, song.name), Change(start, speed, tuple(steps))


def faster_and_higher(y: np.ndarray, speed: float, semitones: float) -> np.ndarray:
    r"""Change tempo and pitch, each by itself, (n,) -> (n / speed,).

    Resampling by $b = 2^{s/12}$ changes both; a phase vocoder then puts the tempo right.

    >>> len(faster_and_higher(np.zeros(22050, dtype=np.float32), 1.0, 0.0))
    22050
    """
    librosa = import_librosa()

    higher = 2 ** (semitones / 12)
    if higher != 1:
        y = librosa.resample(y, orig_sr=RATE * higher, target_sr=RATE, res_type="soxr_mq")
    if abs(speed / higher - 1) > 1e-9:
        y = librosa.effects.time_stretch(y, rate=speed / higher)
    return y


def room(y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A hall: an impulse response of noise that dies away, its high tones first."""
    decay = rng.uniform(0.1, 0.9)  # seconds until 60 dB less
    sec = np.arange(int(decay * RATE)) / RATE
    tail = rng.normal(size=len(sec)) * 10 ** (-3 * sec / decay)
    tail = sosfilt(butter(1, rng.uniform(1500, 7000), fs=RATE, output="sos"), tail)
    late = oaconvolve(y, tail / np.sqrt((tail**2).sum()))[: len(y)]
    return y + rng.uniform(0.1, 0.8) * late


def band_filter(y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A small speaker, a wall between, or a telephone."""
    kind = rng.choice(["low", "high", "telephone"])
    if kind == "low":
        sos = butter(2, rng.uniform(1500, 7000), "low", fs=RATE, output="sos")
    elif kind == "high":
        sos = butter(2, rng.uniform(60, 400), "high", fs=RATE, output="sos")
    else:
        sos = butter(2, [300, 3400], "band", fs=RATE, output="sos")
    return sosfilt(sos, y)


def shelf(y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """More or less bass or treble, up to 9 dB."""
    low = sosfilt(butter(1, rng.uniform(150, 4000), fs=RATE, output="sos"), y)
    gain = 10 ** (rng.uniform(-9, 9) / 20)
    return gain * low + (y - low) if rng.random() < 0.5 else low + gain * (y - low)


def level(y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Loudness that wanders by up to 6 dB within half a minute or so."""
    knots = 2 + int(len(y) / RATE / rng.uniform(10, 40))
    gains = rng.uniform(-6, 0, knots)
    return y * 10 ** (np.interp(np.linspace(0, knots - 1, len(y)), np.arange(knots), gains) / 20)


def compression(y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Loud parts pressed down, so that all is about equally loud."""
    return np.tanh(rng.uniform(2, 8) * y)


def noise(y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Hiss or rumble, 12 to 40 dB below the song."""
    hiss = rng.normal(size=len(y))
    if rng.random() < 0.5:
        hiss = sosfilt(butter(1, rng.uniform(100, 1500), fs=RATE, output="sos"), hiss)
    rms = np.sqrt(np.mean(y**2) / np.mean(hiss**2))
    return y + rms * 10 ** (-rng.uniform(12, 40) / 20) * hiss


def codec(y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What mp3 or ogg leave of it at a low rate; as long as before."""
    import soundfile

    kind = str(rng.choice(["MP3", "OGG"]))
    file = io.BytesIO()
    quality = float(rng.uniform(0.6, 0.95))  # 1 is the smallest file
    shape: dict = {"samplerate": RATE, "channels": 1, "format": kind}
    with soundfile.SoundFile(file, "w", compression_level=quality, **shape) as sound:
        for start in range(0, len(y), RATE):  # in blocks: see `Music.save`
            sound.write(0.95 * y[start : start + RATE])
    file.seek(0)
    back, _ = soundfile.read(file, dtype="float32")
    return np.pad(back, (0, max(0, len(y) - len(back))))[: len(y)]


_STEPS = {
    "room": room,
    "filter": band_filter,
    "shelf": shelf,
    "level": level,
    "compression": compression,
    "noise": noise,
    "codec": codec,
}
