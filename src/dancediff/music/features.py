r"""The 35-d music features at exactly 30 frames a second.

Read first: notebook 02 · Lodge section 3.1 · TCDiff++ section 3.2.

Symbols (axes: f frames at 30 fps · m = 35 features)
    samples   mono sound at 15,360 Hz                               (n,)
    M         onset 1 | MFCC 20 | CENS chroma 12 | peaks 1 | beats 1  (f, 35),  f = 1 + n // 512
"""

import warnings
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from dancediff.axes import FPS
from dancediff.music.beat_tracking import TrackedBeats, beat_onset, track_beats
from dancediff.music.frame_parts import parts_of, sound_of
from dancediff.music.librosa_import import import_librosa
from dancediff.music.sound_rate import HOP, SAMPLE_RATE

NUM_FEATURES = 35
ONSET = slice(0, 1)
MFCC = slice(1, 21)
CHROMA = slice(21, 33)
PEAKS = slice(33, 34)
BEATS = slice(34, 35)
BLOCKS = {"onset": ONSET, "mfcc": MFCC, "chroma": CHROMA, "peaks": PEAKS, "beats": BEATS}
LATE = 0.045  # seconds from a beat to its top in librosa's onset envelope, measured on songs
_MASKED = 1e6  # a std so large that no value is far from the mean
_SHORTEST_SOUND = 16 * HOP  # half a second, as librosa's filters want; shorter sound is padded
WINDOW = 2048  # samples of a spectrum
_BELOW = 1068  # samples of one that ends at 4 kHz, where librosa's pitches do
_RATE: dict[str, Any] = {"sr": SAMPLE_RATE, "hop_length": HOP}
BINS = 36  # notes an octave
_AT_ONCE = 9000  # frames: spectra of five minutes take a quarter of a gigabyte
_REACH = 150  # frames around a part that its lowest chroma filters and their resampling can see


def music_features(
    samples: np.ndarray,
    *,
    at_once: int = _AT_ONCE,
    beats: Callable[[], TrackedBeats] | None = None,
) -> np.ndarray:
    r"""Onset envelope, 20 MFCC, 12 CENS chroma, onset peaks and beats of a whole song.

    Source: the EDGE baseline, FineDance and Lodge (35-d).  Differs: EDGE computes them for each
    5 s slice, which breaks beats at the cuts, and all of them take librosa's beats, which go on
    where music has none; the released TCDiff++ uses 438 dimensions at 60 fps.

    ``beats`` returns those of `track_beats`, if somebody tracks them already; it is called last.
    Spectra are taken of ``at_once`` frames at a time, so a song of two hours fits into memory; the
    result is the same but for rounding.

    Shapes: samples (n,) at 15,360 Hz -> float32 (1 + n // 512, 35), always finite.
    Raises: ValueError when samples are not a vector of finite numbers.

    >>> M = music_features(np.zeros(15360, dtype=np.float32))          # one second of silence
    >>> M.shape, bool(np.isfinite(M).all())
    ((31, 35), True)
    """
    librosa = import_librosa()

    y = np.asarray(samples, dtype=np.float32)
    if y.ndim != 1 or not np.isfinite(y).all():
        raise ValueError(f"samples with shape {y.shape} must be one row of finite numbers")
    frames = 1 + len(y) // HOP
    whole = y
    if len(y) < _SHORTEST_SOUND:
        y = np.pad(y, (0, _SHORTEST_SOUND - len(y)))
    with warnings.catch_warnings():
        # empty mel bands and untunable silence are no news to the caller
        warnings.simplefilter("ignore")
        mel, tuning = _mel_and_tuning(y, at_once)
        mel = librosa.power_to_db(mel)
        onset = librosa.onset.onset_strength(S=mel, **_RATE)
        mfcc = librosa.feature.mfcc(S=mel, n_mfcc=20, sr=SAMPLE_RATE)
        chroma = librosa.feature.chroma_cens(C=_constant_q(y, tuning, at_once), **_RATE)
        peaks = librosa.onset.onset_detect(onset_envelope=onset, **_RATE)
    M = np.zeros((len(onset), NUM_FEATURES), dtype=np.float32)
    M[:, ONSET] = onset[:, None]
    M[:, MFCC] = mfcc.T
    M[:, CHROMA] = chroma.T
    M[peaks, PEAKS] = 1
    tracked = track_beats(beat_onset(whole)) if beats is None else beats()
    at = np.round((tracked.times + LATE) * FPS).astype(int)
    M[at[at < len(M)], BEATS] = 1
    return np.nan_to_num(M[:frames], copy=False)


def _mel_and_tuning(y: np.ndarray, at_once: int) -> tuple[np.ndarray, float]:
    """Power in 128 mel bands (128, f), and by how much of a semitone's third all notes are off."""
    librosa = import_librosa()

    mel, pitches, loud = [], [], []
    for start, stop in parts_of(1 + len(y) // HOP, at_once):
        part = sound_of(y, start, stop, hop=HOP, window=WINDOW)
        S = np.abs(librosa.stft(part, n_fft=WINDOW, hop_length=HOP, center=False))
        mel.append(librosa.feature.melspectrogram(S=S**2, sr=SAMPLE_RATE))
        pitch, strength = _pitches(S)
        pitches.append(pitch)
        loud.append(strength)
    pitch, strength = np.concatenate(pitches), np.concatenate(loud)
    clear = pitch[strength >= np.median(strength)] if len(pitch) else pitch
    tuning = librosa.pitch_tuning(clear, bins_per_octave=BINS) if len(clear) else 0.0
    return np.concatenate(mel, axis=1), float(tuning)


def _pitches(S: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies that sound in a spectrum, and how loud each is; both (k,).

    librosa looks for pitches up to 4 kHz. The bins above take as long and say only which pitches
    are too soft to count, so it gets the loudest bin of each frame instead of them.
    """
    librosa = import_librosa()

    pitch, strength = librosa.piptrack(
        S=S[: _BELOW // 2 + 1],
        sr=_BELOW * SAMPLE_RATE / WINDOW,
        n_fft=_BELOW,
        ref=lambda below, axis: S.max(axis=axis),
    )
    return pitch[pitch > 0], strength[pitch > 0]


def _constant_q(y: np.ndarray, tuning: float, at_once: int) -> np.ndarray:
    """Strength of 36 notes an octave over seven octaves, (252, f)."""
    librosa = import_librosa()

    parts, frames = [], 1 + len(y) // HOP
    for start, stop in parts_of(frames, at_once):
        first, last = max(start - _REACH, 0), min(stop + _REACH, frames)
        part = y[first * HOP : last * HOP]
        C = np.abs(librosa.cqt(part, n_bins=7 * BINS, bins_per_octave=BINS, tuning=tuning,
                               **_RATE))  # fmt: skip
        parts.append(C[:, start - first : stop - first])
    return np.concatenate(parts, axis=1)


def beat_frames(M: Tensor) -> np.ndarray:
    """Frames on which a beat falls; (f, 35) -> int (k,).

    They keep the time of the columns of onsets and peaks, which is `LATE` after the sound.

    >>> M = torch.zeros(40, 35)
    >>> M[[5, 20], BEATS] = 1
    >>> beat_frames(M).tolist()
    [5, 20]
    """
    return np.flatnonzero(M[:, BEATS.start].numpy() > 0.5)


def beat_times(M: Tensor) -> np.ndarray:
    """Seconds at which the beats of the features sound, within half a frame; (f, 35) -> (k,).

    >>> M = torch.zeros(40, 35)
    >>> M[[1, 30], BEATS] = 1
    >>> beat_times(M).round(3).tolist()
    [0.0, 0.955]
    """
    return np.maximum(beat_frames(M) / FPS - LATE, 0)


def in_dance_time(beats: Tensor) -> Tensor:
    """The column of beats, moved to the frames of a dance on which they sound; (..., f) -> same.

    >>> in_dance_time(torch.tensor([0.0, 0, 1, 0])).tolist()
    [0.0, 1.0, 0.0, 0.0]
    """
    late = round(LATE * FPS)
    return torch.cat([beats[..., late:], torch.zeros_like(beats[..., :late])], dim=-1)


def dance_frames(M: Tensor) -> np.ndarray:
    """Frames of a dance on which beats sound: where its rests should lie; (f, 35) -> int (k,).

    >>> M = torch.zeros(40, 35)
    >>> M[[1, 30], BEATS] = 1
    >>> dance_frames(M).tolist(), beat_frames(M).tolist()
    ([0, 29], [1, 30])
    """
    return np.flatnonzero(in_dance_time(M[:, BEATS.start]).numpy() > 0.5)


class MusicNormalizer(nn.Module):
    r"""Standardise features with statistics of the training set, and keep them in range.

    $$\tilde M = \operatorname{clip}\big((M - \mu) / \sigma,\ -4,\ 4\big)$$

    The two binary columns (peaks, beats) stay 0 and 1.
    Source: ours; the papers feed raw values, so an unseen loud song is far outside the training
    range.

    >>> norm = MusicNormalizer.fit([torch.randn(50, 35) * 9 + 2])
    >>> norm.normalize(torch.full((1, 35), 1e6)).max().item()
    1000000.0
    >>> norm.normalize(torch.full((1, 35), 1e6))[:, :33].max().item()
    4.0
    """

    mean: Tensor
    std: Tensor

    def __init__(self, mean: Tensor, std: Tensor):
        super().__init__()
        self.register_buffer("mean", mean.clone().float())
        self.register_buffer("std", std.clone().float())

    @classmethod
    def fit(cls, songs: list[Tensor]) -> "MusicNormalizer":
        """Mean and standard deviation of each column over all frames of all songs.

        Raises: ValueError for no song, or values that are not finite.
        """
        if isinstance(songs, Tensor) or not len(songs):
            raise ValueError("songs must be a list of one or more features (f, 35), one a song")
        M = torch.cat(songs)
        if not M.isfinite().all():
            raise ValueError("songs has NaN or infinite values; leave such a song out")
        mean, std = M.mean(0), M.std(0, correction=int(len(M) > 1)).clamp_min(1e-3)
        mean[PEAKS.start :], std[PEAKS.start :] = 0, 1
        return cls(mean, std)

    def without(self, blocks: Iterable[str]) -> "MusicNormalizer":
        """One that turns every value of these `BLOCKS` into 0, the mean: they are masked.

        Raises: ValueError naming what is no block.

        >>> norm = MusicNormalizer(torch.zeros(35), torch.ones(35)).without(["chroma"])
        >>> norm.normalize(torch.ones(1, 35))[0, 20:23].round(decimals=4).tolist()
        [1.0, 0.0, 0.0]
        """
        std = self.std.clone()
        for name in blocks:
            if name not in BLOCKS:
                raise ValueError(f"masked_music: {name!r} is not one of {', '.join(BLOCKS)}")
            std[BLOCKS[name]] = _MASKED
        return MusicNormalizer(self.mean, std)

    def normalize(self, M: Tensor) -> Tensor:
        """(…, 35) raw -> standardised, cut to [-4, 4] but for the binary columns."""
        x = (M - self.mean) / self.std
        return torch.cat([x[..., : PEAKS.start].clamp(-4, 4), x[..., PEAKS.start :]], dim=-1)
