r"""BAS and MMC: does the body come to rest on the beats of the music?

Read first: notebook 13 · Lodge and Bailando (BAS) · AIST++ and GCD (MMC).

Symbols (axes: n dancers · f frames · j joints · k beats)
    joints  positions, metres, y up               (n, f, j, 3) or (f, j, 3)
    beats   times of the music's beats, seconds   (k,)
    m       times of the motion's beats, seconds  (l,)
    sigma   how far off still counts, seconds
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import argrelmin
from torch import Tensor

from dancediff.metrics.inputs import as_group, check_compat
from dancediff.motion.beats import motion_beats

SIGMA = 0.1  # seconds: 3 frames at 30 fps
SMOOTH = 0.05  # seconds: 1.5 frames at 30 fps, as in motion_beats
LODGE_SIGMA, LODGE_SMOOTH = 3.0, 5.0  # frames, whatever the frame rate
AIST_SIGMA, AIST_ORDER = 2.12, 5  # frames at 30 fps: 3 / sqrt(2), and half of the 10 at 60 fps
DIRECTION = {"lodge": "music", "aist": "motion", "gcd": "motion"}


def beat_alignment(
    joints: Tensor,
    beats,
    *,
    fps: float = 30.0,
    direction: str = "music",
    compat: str | None = None,
) -> float:
    r"""How close beats of music and motion lie, in [0, 1]; higher is better.

    $$\mathrm{BAS} = \frac1{|b|} \sum_{b} e^{-\min_m (m - b)^2 / 2\sigma^2},\qquad
      \mathrm{MMC} = \frac1{|m|} \sum_{m} e^{-\min_b (m - b)^2 / 2\sigma^2},\quad
      \sigma = 0.1\text{ s}$$

    ``direction="music"`` asks every beat of the music for a motion beat (BAS), "motion" every
    motion beat for one of the music (MMC). Each dancer is scored alone, and the mean is returned.
    A dancer without any motion beat scores 0. BAS alone can be fooled: a body that trembles has
    motion beats everywhere. MMC alone too: one motion beat on a beat is enough.

    Source: Bailando and Lodge (BAS), AIST++ and GCD (MMC).  Differs: motion beats are those of
    `motion_beats`, smoothed over 0.05 s; only beats that fall within the clip count; one sigma for
    both directions. With any ``compat`` beats after the motion's end count too. "lodge" (music):
    smoothed over 5 frames, which merges fast beats, sigma of 3 frames. "aist" or "gcd" (motion):
    minima over 5 frames to each side of the joints' summed speed, not smoothed, sigma of 2.12
    frames; at 60 fps 10 frames and 3. The published codes find the beats themselves; here
    the caller brings them.

    Shapes/units: joints (n, f, 24, 3) metres, beats (k,) seconds -> float.
    Raises: ValueError for less than 3 frames, no beat, NaN, a wrong shape, fps, direction, compat.

    >>> import torch
    >>> path = torch.cos(torch.arange(60) / 60 * 4 * torch.pi)      # turns round every 15 frames
    >>> beat_alignment(path[:, None, None] * torch.ones(60, 24, 3), [0.5, 1.0, 1.5])
    1.0
    """
    check_compat(compat, tuple(DIRECTION), "beat alignment")
    if direction not in ("music", "motion"):
        raise ValueError(f"direction={direction!r} is unknown; use 'music' (BAS) or 'motion' (MMC)")
    if compat and DIRECTION[compat] != direction:
        raise ValueError(f"compat={compat!r} is defined for direction={DIRECTION[compat]!r} only")
    dancers = as_group(joints, fps, least=3)
    beats = _beats(beats, float("inf") if compat else dancers.shape[1] / fps)
    find, sigma = _variant(compat, fps)
    scores = []
    for dancer in dancers:
        m = find(dancer, fps) / fps
        first, second = (beats, m) if direction == "music" else (m, beats)
        scores.append(closeness(first, second, sigma))
    return float(np.mean(scores))


def closeness(times: np.ndarray, others: np.ndarray, sigma: float) -> float:
    r"""Mean of $e^{-d^2/2\sigma^2}$ over ``times``, d the distance to the nearest of ``others``.

    Shapes: times (k,), others (l,), all in seconds -> float; 0 when either is empty.

    >>> closeness(np.array([1.0, 2.0]), np.array([1.0, 9.0]), 0.1)
    0.5
    """
    if not len(times) or not len(others):
        return 0.0
    others = np.sort(others)
    after = np.searchsorted(others, times).clip(1, len(others) - 1) if len(others) > 1 else 0
    nearest = np.minimum(np.abs(times - others[after]), np.abs(times - others[after - 1]))
    return float(np.exp(-(nearest**2) / (2 * sigma**2)).mean())


def _variant(compat: str | None, fps: float):
    """How motion beats are found, and sigma in seconds."""
    if compat == "lodge":
        return _lodge, LODGE_SIGMA / fps
    if compat:
        return _aist, AIST_SIGMA * (fps / 30) ** 0.5 / fps
    return _default, SIGMA


def _beats(beats, end: float) -> np.ndarray:
    """The beats up to ``end`` seconds, checked."""
    try:
        beats = np.asarray(beats, dtype=np.float64)
    except (TypeError, ValueError) as err:
        raise ValueError(
            f"beats is a {type(beats).__name__}; give times in seconds (k,), such as song.beats()"
        ) from err
    if beats.ndim != 1 or not np.isfinite(beats).all():
        raise ValueError(f"beats has shape {beats.shape}; expected (k,) finite times in seconds")
    inside = beats[(beats >= 0) & (beats < end)]
    if not len(inside):
        raise ValueError(
            f"beats has {len(beats)} times, none of them within the motion; "
            "pass the beats of the same stretch of music, in seconds"
        )
    return inside


def _default(joints: Tensor, fps: float) -> np.ndarray:
    return motion_beats(joints, sigma=SMOOTH * fps)


def _lodge(joints: Tensor, fps: float) -> np.ndarray:
    speed = joints.diff(dim=0).norm(dim=-1).mean(-1).numpy()
    return argrelmin(gaussian_filter1d(speed, LODGE_SMOOTH))[0]


def _aist(joints: Tensor, fps: float) -> np.ndarray:
    speed = joints.diff(dim=0).norm(dim=-1).sum(-1).numpy()
    return argrelmin(speed, order=max(1, round(AIST_ORDER * fps / 30)))[0]
