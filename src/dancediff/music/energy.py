r"""How loud the music is at each moment, beside the loud parts of its own song.

Read first: notebook 02 · ITU-R BS.1770-4 (the gate of a song's mean loudness).

Symbols (axes: f frames at 30 fps · m = 35 features · k MFCC · b mel bands)
    M   music features, raw                                        (f, m)
    L   A-weighted level over about a second, in dB                (f,)
    E   energy, 0 for silence ... 1 for the loudest                (f,)
"""

import math
from functools import cache

import torch
from torch import Tensor
from torch.nn import functional as F

from dancediff.axes import FPS
from dancediff.music.features import MFCC, NUM_FEATURES, SAMPLE_RATE
from dancediff.music.librosa_import import import_librosa

EVEN = 0.65  # energy of a song that is always equally loud
SLOPE = 25.0  # dB from no energy to all of it
_GATE = 0.1  # parts 10 dB under the mean do not count to a song's own loudness (BS.1770)
_SILENT_POWER = 1e-5  # songs whose features are taken by `Music` are seven powers of ten above
_BANDS = 128  # mel bands that the MFCC were made of
_SMOOTH = FPS // 2  # frames of each of two mean filters; together they reach over a second
_AT_ONCE = 9000  # frames whose spectra are in memory


def song_loudness(M: Tensor) -> float:
    r"""How loud the loud parts of a song are, $L_{\text{song}}$ in dB; -inf of silence.

    Shapes: M (f, 35), raw, of a whole song.

    >>> M = torch.zeros(300, 35)
    >>> round(song_loudness(torch.cat([M, M])) - song_loudness(M), 6)
    0.0
    """
    return loudness_of(frame_power(M))


def loudness_of(power: Tensor) -> float:
    """How loud the loud parts are, from the A-weighted power of each frame (f,); in dB.

    >>> round(loudness_of(torch.tensor([0.0, 1.0, 100.0])), 6)       # the others are 10 dB under it
    20.0
    """
    sounding = power > _SILENT_POWER
    if not sounding.any():
        return -math.inf
    return 10 * math.log10(power[power > _GATE * power[sounding].mean()].mean().item())


def energy_curve(M: Tensor, loudness: float | None = None) -> Tensor:
    r"""How loud the music is now, relative to the loud parts of the whole song, within 0..1.

    $$E_f = \operatorname{clip}\big(0.65 + (L_f - L_{\text{song}}) / 25\,\text{dB},\ 0,\ 1\big)$$

    $L_{\text{song}}$ is the mean power of the frames that are less than 10 dB under the mean, so
    silence around a song changes nothing. The slope is fixed: a song with little dynamics stays
    near 0.65, it is not stretched to the full range. A constant gain changes nothing either.

    The spectrum is the smooth one that 20 MFCC hold. Where a few bare tones make the loudness, it
    tells less than the sound itself.

    Source: ours; gate of ITU-R BS.1770-4.
    Shapes: M (f, 35), raw, of a whole song, or of a part of one with the ``loudness`` of the whole
    -> (f,).
    Raises: ValueError when M has another shape or no frame.

    >>> M = torch.zeros(300, 35)
    >>> M[:150, MFCC.start] -= 60                              # the first half is 5 dB more quiet
    >>> [round(E, 2) for E in energy_curve(M)[[0, 299]].tolist()]
    [0.51, 0.73]
    """
    if M.ndim != 2 or M.shape[1] != NUM_FEATURES or not len(M):
        raise ValueError(
            f"M has shape {tuple(M.shape)}; expected (f, {NUM_FEATURES}) with f >= 1: "
            "the features of a song, as Music.features() returns them"
        )
    loudness = song_loudness(M) if loudness is None else loudness
    if loudness == -math.inf:
        return torch.zeros(len(M))
    now = _smooth(frame_power(M))
    energy = EVEN + (10 * torch.log10(now.clamp_min(_SILENT_POWER)) - loudness) / SLOPE
    return torch.where(now > _SILENT_POWER, energy, 0).clamp(0, 1).float()


def frame_power(M: Tensor) -> Tensor:
    """A-weighted power of each frame, (f, 35) -> (f,) float64.

    >>> frame_power(torch.zeros(2, NUM_FEATURES)).shape
    torch.Size([2])
    """
    basis, weight = _bands()
    parts = [part[:, MFCC].double() @ basis for part in M.split(_AT_ONCE)]  # dB, (f, b)
    return torch.cat([10 ** (part / 10) @ weight for part in parts])


@cache
def _bands() -> tuple[Tensor, Tensor]:
    """Inverse cosine transform of 20 MFCC (k, b), and what each band adds to loudness (b,)."""
    librosa = import_librosa()

    k = torch.arange(MFCC.stop - MFCC.start, dtype=torch.float64)
    b = torch.arange(_BANDS) + 0.5
    basis = torch.cos(torch.pi * k[:, None] * b / _BANDS) * (2 / _BANDS) ** 0.5
    basis[0] /= 2**0.5
    hertz = librosa.mel_frequencies(_BANDS + 2, fmin=0, fmax=SAMPLE_RATE / 2)
    # mel bands hold power a hertz, so their width counts
    weight = (hertz[2:] - hertz[:-2]) * 10 ** (librosa.A_weighting(hertz[1:-1]) / 10)
    return basis, torch.from_numpy(weight)


def _smooth(x: Tensor) -> Tensor:
    """Mean over about a second, (f,) -> (f,); at the ends over what there is."""
    for _ in range(2):
        x = F.avg_pool1d(x[None], _SMOOTH, stride=1, padding=_SMOOTH // 2, count_include_pad=False)[
            0
        ]
    return x
