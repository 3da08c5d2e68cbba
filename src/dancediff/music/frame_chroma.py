r"""The chroma of single frames, for sound that is not there as a whole.

Read first: `dancediff.music.features` · Brown and Puckette 1992, "An efficient algorithm for the
calculation of a constant Q transform", eq. 5 (kernels in the frequency domain) · Müller and Ewert
2011, "Chroma toolbox", section 2 (CENS).

Symbols (axes: n samples · f frames · k 252 notes, three a semitone)
    y        sound around a frame                                     (n,), n = 32,768
    kernel   spectrum of a windowed complex wave of each note         (k, 1 + n / 2)
"""

from functools import cache

import numpy as np
from scipy import fft
from scipy.ndimage import convolve1d
from scipy.sparse import csr_matrix, vstack

from dancediff.music.features import BINS
from dancediff.music.librosa_import import import_librosa
from dancediff.music.sound_rate import SAMPLE_RATE

SPAN = 1 << 15  # samples that the lowest note's filter lies in
REACH = 24  # frames on both sides that it can see: 0.8 s
_OCTAVES = 7
_LEVELS = (0.4, 0.2, 0.1, 0.05)  # of the sum of all pitch classes; each passed adds a quarter
_SMOOTH = 43  # frames of the smoothing window, its two zeros included


@cache
def _kernel() -> tuple[csr_matrix, np.ndarray]:
    """Kernels of all notes, and which pitch class each belongs to (12, k)."""
    librosa = import_librosa()

    low = float(librosa.note_to_hz("C1"))
    hertz = librosa.cqt_frequencies(BINS * _OCTAVES, fmin=low, bins_per_octave=BINS)
    rows = []
    for k in range(len(hertz)):
        # a filter's width follows from its neighbours, so three are asked for
        near = slice(max(k - 1, 0), k + 2)
        waves, lengths = librosa.filters.wavelet(freqs=hertz[near], sr=SAMPLE_RATE, pad_fft=False)
        wave, length = waves[k - near.start], lengths[k - near.start]
        spectrum = fft.fft(librosa.util.pad_center(wave, size=SPAN))[: SPAN // 2 + 1]
        spectrum = spectrum[None] * np.sqrt(length) / SPAN
        rows.append(librosa.util.sparsify_rows(spectrum, quantile=0.01, dtype=np.complex64))
    return vstack(rows).tocsr(), librosa.filters.cq_to_chroma(len(hertz), bins_per_octave=BINS)


def chroma_levels(y: np.ndarray) -> np.ndarray:
    r"""How strong each pitch class is in the middle of a sound, in five levels, 0 to 1.

    $$C_k = \Big|\sum_\nu \hat y_\nu\,\hat\kappa_{k,\nu}\Big|$$

    Source: Brown and Puckette 1992, eq. 5.  Differs from the features of whole songs: there low
    notes are found in a slower copy of the song, and all notes are tuned to it; here A is 440 Hz.

    Shapes: y (32768,) -> (12,), C first.

    >>> t = np.arange(SPAN) / SAMPLE_RATE
    >>> chroma_levels(np.sin(2 * np.pi * 440 * t)).tolist()                          # an A
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    """
    kernel, classes = _kernel()
    chroma = classes @ np.abs(kernel @ fft.rfft(y.astype(np.float32)))
    total = chroma.sum()
    if total < np.finfo(np.float32).tiny:
        return np.zeros(len(chroma))
    return np.sum([chroma / total > level for level in _LEVELS], axis=0) / len(_LEVELS)


def cens(levels: np.ndarray) -> np.ndarray:
    """Smoothed over 1.4 s, and each frame of length 1 or 0; (f, 12) -> (f, 12).

    >>> cens(np.eye(12)[[0] * 50])[25].round(2).tolist()[:3]
    [1.0, 0.0, 0.0]
    """
    window = np.hanning(_SMOOTH)
    smooth = convolve1d(levels, window / window.sum(), axis=0, mode="constant")
    norm = np.linalg.norm(smooth, axis=1, keepdims=True)
    return np.divide(smooth, norm, out=np.zeros_like(smooth), where=norm > 1e-9)
