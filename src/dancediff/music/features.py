r"""The 35-d music features at exactly 30 frames a second.

Read first: notebook 02 · Lodge section 4.1 · TCDiff++ section 5.1.

Symbols (axes: f frames at 30 fps · m = 35 features)
    samples   mono sound at 15,360 Hz                               (n,)
    M         onset 1 | MFCC 20 | CENS chroma 12 | peaks 1 | beats 1  (f, 35),  f = 1 + n // 512
"""

import warnings
from collections.abc import Iterable

import numpy as np
import torch
from torch import Tensor, nn

FPS = 30
HOP = 512
SAMPLE_RATE = FPS * HOP  # 15,360 Hz makes a hop of 512 samples exactly one frame of 30 fps
NUM_FEATURES = 35
ONSET = slice(0, 1)
MFCC = slice(1, 21)
CHROMA = slice(21, 33)
PEAKS = slice(33, 34)
BEATS = slice(34, 35)
BLOCKS = {"onset": ONSET, "mfcc": MFCC, "chroma": CHROMA, "peaks": PEAKS, "beats": BEATS}
_UNHEARD = 1e6  # a spread so wide that no value is far from the mean
_SHORTEST = 16 * HOP  # librosa's filters want half a second; shorter sound is padded with silence


def music_features(samples: np.ndarray) -> np.ndarray:
    r"""Onset envelope, 20 MFCC, 12 CENS chroma, onset peaks and beats of a whole song.

    Source: the EDGE baseline, FineDance and Lodge (35-d).  Differs: EDGE computes them for each
    5 s slice, which breaks beats at the cuts; the released TCDiff++ uses 438 dimensions at 60 fps.

    Shapes: samples (n,) at 15,360 Hz -> float32 (1 + n // 512, 35), always finite.
    Raises: ValueError when samples are not a vector of finite numbers.

    >>> M = music_features(np.zeros(15360, dtype=np.float32))          # one second of silence
    >>> M.shape, bool(np.isfinite(M).all())
    ((31, 35), True)
    """
    import librosa

    y = np.asarray(samples, dtype=np.float32)
    if y.ndim != 1 or not np.isfinite(y).all():
        raise ValueError(f"samples with shape {y.shape} must be one row of finite numbers")
    frames = 1 + len(y) // HOP
    if len(y) < _SHORTEST:
        y = np.pad(y, (0, _SHORTEST - len(y)))
    rate = {"sr": SAMPLE_RATE, "hop_length": HOP}
    with warnings.catch_warnings():
        # empty mel bands and untunable silence are no news to the caller
        warnings.simplefilter("ignore")
        onset = librosa.onset.onset_strength(y=y, **rate)
        mfcc = librosa.feature.mfcc(y=y, n_mfcc=20, **rate)
        chroma = librosa.feature.chroma_cens(y=y, n_chroma=12, **rate)
        peaks = librosa.onset.onset_detect(onset_envelope=onset, **rate)
        beats = detect_beats(onset, peaks)
    M = np.zeros((len(onset), NUM_FEATURES), dtype=np.float32)
    M[:, ONSET] = onset[:, None]
    M[:, MFCC] = mfcc.T
    M[:, CHROMA] = chroma.T
    M[peaks, PEAKS] = 1
    M[beats, BEATS] = 1
    return np.nan_to_num(M[:frames], copy=False)


def detect_beats(onset: np.ndarray, peaks: np.ndarray) -> np.ndarray:
    """Beat frames of an onset envelope, by librosa's tracker around the song's own tempo.

    They go from the first to the last of the ``peaks``, the frames of clear onsets. librosa's own
    rule ends them where they get weak, and so leaves a fading song without beats for seconds;
    dancers do not stop there.

    >>> detect_beats(np.zeros(100), np.zeros(0)).tolist()
    []
    """
    import librosa

    if not len(peaks):
        return np.zeros(0, dtype=int)
    rate = {"sr": SAMPLE_RATE, "hop_length": HOP}
    tempo = librosa.feature.tempo(onset_envelope=onset, **rate)[0]
    _, beats = librosa.beat.beat_track(
        onset_envelope=onset, start_bpm=float(tempo), tightness=100, trim=False, **rate
    )
    return beats[(beats >= peaks[0]) & (beats <= peaks[-1])]


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

    def __init__(self, mean: Tensor, std: Tensor):
        super().__init__()
        self.register_buffer("mean", mean.clone().float())
        self.register_buffer("std", std.clone().float())

    @classmethod
    def fit(cls, songs: list[Tensor]) -> "MusicNormalizer":
        """Mean and standard deviation of each column over all frames of all songs."""
        M = torch.cat(songs)
        mean, std = M.mean(0), M.std(0).clamp_min(1e-3)
        mean[PEAKS.start :], std[PEAKS.start :] = 0, 1
        return cls(mean, std)

    def without(self, blocks: Iterable[str]) -> "MusicNormalizer":
        """One that turns every value of these `BLOCKS` into 0, the mean: the model is deaf to them.

        Raises: ValueError naming what is no block.

        >>> norm = MusicNormalizer(torch.zeros(35), torch.ones(35)).without(["chroma"])
        >>> norm.normalize(torch.ones(1, 35))[0, 20:23].round(decimals=4).tolist()
        [1.0, 0.0, 0.0]
        """
        std = self.std.clone()
        for name in blocks:
            if name not in BLOCKS:
                raise ValueError(f"unheard: {name!r} is not one of {', '.join(BLOCKS)}")
            std[BLOCKS[name]] = _UNHEARD
        return MusicNormalizer(self.mean, std)

    def normalize(self, M: Tensor) -> Tensor:
        """(…, 35) raw -> standardised, cut to [-4, 4] but for the binary columns."""
        x = (M - self.mean) / self.std
        return torch.cat([x[..., : PEAKS.start].clamp(-4, 4), x[..., PEAKS.start :]], dim=-1)
