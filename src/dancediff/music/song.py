r"""`Music`: a song of any format, rate and length, and what a network hears of it.

Read first: notebook 02.
"""

import warnings
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dancediff.atomic import atomic_write
from dancediff.music.beat_tracking import TrackedBeats, beat_onset, track_beats
from dancediff.music.cut_off import missing_share
from dancediff.music.features import music_features
from dancediff.music.librosa_import import import_librosa
from dancediff.music.mono import mono_mix, turned_round
from dancediff.music.sound_on_disk import SOUND_SUFFIXES, SoundOnDisk
from dancediff.music.sound_rate import HOP, SAMPLE_RATE, whole_rate
from dancediff.threads import begun_beside

SILENT = 1e-4  # peak below which a song counts as silent
LONG = 1 << 26  # samples (12 minutes in stereo) from which on a song's sound stays in its file
_PART = 1 << 24  # samples that are squared at a time
LOUDNESS = 0.1  # RMS to which a song is set before its features are taken


class _kept(cached_property):
    """`cached_property` as it is from Python 3.12 on: one song does not wait for another's.

    That of Python 3.11 has one lock for all objects of a class.
    """

    def __get__(self, instance, owner=None):
        if instance is None:
            return self
        known = vars(instance)
        if self.attrname not in known:
            known[self.attrname] = self.func(instance)
        return known[self.attrname]


@dataclass(frozen=True, eq=False)
class Music:
    """Sound samples with their rate.

    audio (n, channels) float32, mostly in [-1, 1]; rate in Hz. Integers of 16 or 32 bits are
    divided by their range, as sound files are read. Of a long file it stays on disk: ``audio`` then
    is a `SoundOnDisk`, of which parts can be taken as of an array.

    Raises: ValueError when the samples are not such an array, or not finite.

    >>> song = Music(np.zeros((44100, 2), dtype=np.float32), 44100)
    >>> song.duration, song.num_frames, song.is_silent
    (1.0, 31, True)
    """

    audio: np.ndarray | SoundOnDisk = field(repr=False)
    rate: int
    name: str = "song"

    def __post_init__(self):
        object.__setattr__(self, "rate", whole_rate(self.rate))
        audio, on_disk = self.audio, isinstance(self.audio, SoundOnDisk)
        if not on_disk:
            audio = _as_float(np.asarray(audio))
            audio = audio[:, None] if audio.ndim == 1 else audio
        if audio.ndim != 2 or audio.shape[1] < 1 or len(audio) == 0:
            raise ValueError(f"audio has shape {audio.shape}; expected (n, channels), n >= 1")
        if turned_round(audio.shape):
            raise ValueError(
                f"audio has shape {audio.shape}, which would be {audio.shape[1]} channels; "
                "expected (n, channels): give audio.T"
            )
        if not (audio.is_finite if on_disk else np.isfinite(audio).all()):
            raise ValueError(f"audio of {self.name!r} has samples that are no finite numbers")
        object.__setattr__(self, "audio", audio)

    @classmethod
    def load(cls, path) -> "Music":
        """Read wav, flac, ogg or mp3, mono or stereo, any rate and length.

        Of a file that was cut off, what is there is read, with a warning where its header tells of
        more.

        Raises: ValueError naming the path and the fix when there is no such sound file.
        """
        import soundfile

        if not isinstance(path, str | PathLike):
            raise ValueError(
                f"path is a {type(path).__name__}; give the path of a wav, flac, ogg or mp3 file"
            )
        path = Path(path)
        if not path.exists():
            fix = "give a wav, flac, ogg or mp3 file"
            if path.name == "packaged":  # so it is called on the command line
                fix = "the packaged song is dancediff.packaged_song()"
            raise ValueError(f"song {str(path)!r} does not exist; {fix}")
        if path.is_dir():
            raise ValueError(f"song {str(path)!r} is a folder; give a wav, flac, ogg or mp3 file")
        if path.stat().st_size == 0:
            raise ValueError(f"song {str(path)!r} is an empty file; give one with sound in it")
        try:
            facts = soundfile.info(path)
            if facts.frames * facts.channels > LONG:
                audio, rate = SoundOnDisk(path), facts.samplerate
            else:
                audio, rate = soundfile.read(path, dtype="float32", always_2d=True)
        except (OSError, RuntimeError, ValueError, TypeError, MemoryError) as err:
            raise ValueError(
                # libsndfile's own words stay with the cause: they call damaged files missing
                f"song {str(path)!r} cannot be read as sound; "
                "give a wav, flac, ogg or mp3 file, or convert it to one"
            ) from err
        if len(audio) == 0:
            raise ValueError(f"song {str(path)!r} holds no samples; give one with sound in it")
        if lost := missing_share(path, facts.frames, len(audio)):
            warnings.warn(
                f"song {str(path)!r} is cut off: it has {len(audio) / rate:.1f} s, {lost:.0%} less "
                "than its header tells; get the whole file, or go on with this part",
                stacklevel=2,
            )
        return cls(audio, rate, path.stem)

    def save(self, path) -> Path:
        """Write the sound, and its folder; the suffix decides the format (.wav .flac .ogg .mp3).

        Raises: ValueError for another suffix.
        """
        import soundfile

        path = Path(path)
        if path.suffix.lower() not in SOUND_SUFFIXES:
            raise ValueError(
                f"suffix {path.suffix!r} of {path} is unknown; use {' '.join(SOUND_SUFFIXES)}"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        shape = self.rate, self.audio.shape[1]
        # in blocks: libsndfile's vorbis encoder overflows its stack on one long write
        with atomic_write(path) as part, soundfile.SoundFile(part, "w", *shape) as file:
            audio = self.audio
            for block in audio.blocks() if isinstance(audio, SoundOnDisk) else [audio]:
                for start in range(0, len(block), self.rate):
                    file.write(block[start : start + self.rate])
        return path

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return len(self.audio) / self.rate

    @property
    def peak(self) -> float:
        """Largest absolute sample of the mean of the channels, which is what is heard."""
        if isinstance(self.audio, SoundOnDisk):
            return self.audio.peak
        return float(np.abs(mono_mix(self.audio)).max())

    @property
    def is_silent(self) -> bool:
        """Nothing to dance to: the peak is under 1e-4."""
        return self.peak < SILENT

    def mono(self, rate: int = SAMPLE_RATE) -> np.ndarray:
        """Mean of the channels, resampled, (n,) float32."""
        if isinstance(self.audio, SoundOnDisk):
            return self.audio.mono(rate)
        y = mono_mix(self.audio)
        if rate == self.rate:
            return y
        librosa = import_librosa()

        return librosa.resample(y, orig_sr=self.rate, target_sr=rate, res_type="soxr_hq")

    def slice(self, start: float, stop: float) -> "Music":
        """The part between two times in seconds; what lies before or behind the song is left out.

        Raises: ValueError when nothing of the song lies between them.
        """
        a, b = (round(min(max(at, 0), self.duration) * self.rate) for at in (start, stop))
        if a >= b:
            raise ValueError(
                f"slice({start}, {stop}) is empty; song {self.name!r} lasts {self.duration:.2f} s"
            )
        return Music(self.audio[a:b], self.rate, self.name)

    @_kept
    def _heard(self) -> tuple[Tensor, TrackedBeats]:
        y = self.mono()
        # loudness says nothing about the dance; the same song recorded softer gives the same dance
        parts = (y[k : k + _PART] for k in range(0, len(y), _PART))
        power = sum(np.square(part, dtype=np.float64).sum() for part in parts)
        rms = float(np.sqrt(power / len(y)))
        if rms > SILENT * 0.1:
            y *= LOUDNESS / rms
        import_librosa()  # by one thread
        beats = begun_beside(lambda: track_beats(beat_onset(y)))  # a second core, if it is idle
        return torch.from_numpy(music_features(y, beats=beats)), beats()

    @property
    def num_frames(self) -> int:
        """Rows of the feature matrix: 1 + samples at 15,360 Hz // 512."""
        return 1 + int(np.ceil(len(self.audio) * SAMPLE_RATE / self.rate)) // HOP

    def features(self) -> Tensor:
        """The 35 features of every frame of the whole song, raw, (f, 35); computed once.

        The song is first set to a fixed loudness (RMS 0.1). Cut the rows, not the song: beats and
        chroma need their surroundings.
        """
        return self._heard[0]

    def beats(self) -> np.ndarray:
        """Times of the tracked beats in seconds, exact to a 60th; none where music has no beat."""
        return self._heard[1].times

    def beat_confidence(self) -> np.ndarray:
        """How sure each of the beats is, 0 to 1."""
        return self._heard[1].confidence

    @property
    def tempo(self) -> float:
        """Beats per minute between the detected beats (median); nan with fewer than two."""
        beats = self.beats()
        return 60 / float(np.median(np.diff(beats))) if len(beats) > 1 else float("nan")


def _as_float(samples: np.ndarray) -> np.ndarray:
    """Samples as float32; integers that are known to be sound fill [-1, 1] with their range.

    Raises: ValueError for other integers: nobody can tell which of them is the loudest.

    >>> _as_float(np.array([-32768, 16384], dtype=np.int16)).tolist()
    [-1.0, 0.5]
    """
    if samples.dtype.kind not in "iub":
        return np.asarray(samples, dtype=np.float32)
    if samples.dtype.kind == "i" and samples.dtype.itemsize in (2, 4):
        return samples.astype(np.float32) / np.float32(1 << (8 * samples.dtype.itemsize - 1))
    raise ValueError(
        f"audio has samples of type {samples.dtype}, whose loudest value is not known; "
        "give int16 or int32, or floats in -1 ... 1"
    )


def as_song(song):
    """A song as it is; of a path the one in that file.

    Raises: ValueError as `Music.load`, and for what is no song.

    >>> song = Music(np.zeros(44100), 44100)
    >>> as_song(song) is song, as_song(None) is None
    (True, True)
    """
    if isinstance(song, str | PathLike):
        return Music.load(song)
    if song is not None and not hasattr(song, "duration"):  # `Music`, `LiveSong`, `Opening`
        raise ValueError(f"song is a {type(song).__name__}; give a Music or a path")
    return song


def needed_song(song):
    """As `as_song`, for those who cannot do without.

    Raises: ValueError as `as_song`, and for None.
    """
    if song is None:
        raise ValueError("song is None; give a Music or a path")
    return as_song(song)
