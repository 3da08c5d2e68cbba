r"""From keys on the beat grid to smooth curves, frame by frame.

Symbols (axes: f frames · k keys or counts · c channels · j joints)
    beat  position of each frame on the beat grid    (f,)
    u     how far a change has come, 0..1            (f,)
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from dancediff.data.choreographer.footsteps import smoothstep
from dancediff.data.choreographer.moves import Style

DIP = 0.7  # how much a flowing movement slows down on the beat
_SOFT_DIP = 0.35  # the same for one that stops anyway
_DRIFT = 0.16  # share of a change that happens while the pose is "held": nobody is a statue


def ease(u: np.ndarray, style: Style) -> np.ndarray:
    r"""Between a soft change, $6u^5-15u^4+10u^3$, and a sudden one, $1-(1-u)^3$.

    >>> ease(np.array([0.0, 0.5, 1.0]), Style(snap=0.5)).round(3).tolist()
    [0.0, 0.688, 1.0]
    """
    return (1 - style.snap) * smoothstep(u) + style.snap * (1 - (1 - u) ** 3)


def warp(beat: np.ndarray, dip: float = DIP) -> np.ndarray:
    r"""Time that slows down on every beat: $b - d\,\sin(2\pi b)/2\pi$.

    >>> warp(np.array([1.0, 1.25, 1.5])).round(3).tolist()
    [1.0, 1.139, 1.5]
    """
    return beat - dip * np.sin(2 * np.pi * beat) / (2 * np.pi)


def count_track(on: np.ndarray, off: np.ndarray, beat: np.ndarray, style: Style) -> np.ndarray:
    """Channels with a value on every count, and what they add on the off-beats.

    Shapes: on, off (..., k, c), beat (f,) -> (..., f, c).

    >>> count_track(np.array([[0.0], [2.0], [2.0]]), np.zeros((3, 1)), np.array([1.0]), Style())
    array([[2.]])
    """
    i = np.clip(np.floor(beat).astype(int), 0, on.shape[-2] - 2)
    p = beat - i
    start = max(0.0, 1 - style.attack)
    soft = ease(np.clip((p - start) / (1 - start), 0, 1), style)
    soft = (1 - _DRIFT) * soft + _DRIFT * smoothstep(p)
    u = ((1 - style.flow) * soft + style.flow * np.clip(warp(p), 0, 1))[:, None]
    bump = (np.sin(np.pi * p) ** 2)[:, None]
    return on[..., i, :] * (1 - u) + on[..., i + 1, :] * u + off[..., i, :] * bump


def smoothed(x: np.ndarray, frames: float, axis: int) -> np.ndarray:
    """Gaussian smoothing over frames; none below a fifth of a frame."""
    return x if frames < 0.2 else gaussian_filter1d(x, frames, axis=axis, mode="nearest")


def pose_track(time, keys, between, through, beat: np.ndarray, style: Style) -> np.ndarray:
    r"""Joints that go from key pose to key pose by way of poses in between.

    $$q(u) \propto (1-u)(1-2u)\,a + 4u(1-u)\,m + u(2u-1)\,b$$

    so that an arm swings in an arc. Outer joints follow inner ones by ``style.lag`` beats.

    Shapes: time (k,) beats, keys (k, j, 4), between (k - 1, j, 4) quaternions, through (k,) keys
    that are not stopped at, beat (f,) -> (f, j, 4) quaternions, not normalised.
    """
    joints = keys.shape[1]
    late = (np.arange(joints) - 1.5).clip(-0.5) * style.lag
    soft_time, even_time = (warp(beat, dip)[:, None] - late for dip in (_SOFT_DIP, DIP))  # (f, j)
    i = np.clip(np.searchsorted(time, soft_time, "right") - 1, 0, len(time) - 2)
    begin, end = time[i], time[i + 1]
    span = end - begin
    start = end - np.minimum(span, style.attack + style.flow * span)
    u = np.clip((soft_time - start) / (end - start), 0, 1)
    soft = ease(u, style)
    # keys that are passed through keep their speed on that side
    soft = np.where(through[i] & through[i + 1], u, soft)
    soft = np.where(through[i] & ~through[i + 1], 1 - (1 - u) ** 2, soft)
    soft = np.where(~through[i] & through[i + 1], u**2, soft)
    even = np.clip((even_time - begin) / span, 0, 1)
    drift = np.where(span < 2.6, _DRIFT, 0.5 * _DRIFT) * (1 - style.flow)
    u = ((1 - style.flow - drift) * soft + style.flow * even + drift * smoothstep(even))[..., None]
    at = np.arange(joints)
    a, m, z = keys[i, at], between[i, at], keys[i + 1, at]
    a = a * np.where((a * m).sum(-1, keepdims=True) < 0, -1.0, 1.0)
    z = z * np.where((z * m).sum(-1, keepdims=True) < 0, -1.0, 1.0)
    return (1 - u) * (1 - 2 * u) * a + 4 * u * (1 - u) * m + u * (2 * u - 1) * z


def same_hemisphere(q: np.ndarray) -> np.ndarray:
    """Flip signs along the first axis so that neighbours are less than half a turn apart.

    >>> same_hemisphere(np.array([[1.0, 0, 0, 0], [-1.0, 0, 0, 0]]))[1].tolist()
    [1.0, -0.0, -0.0, -0.0]
    """
    sign = np.where((q[1:] * q[:-1]).sum(-1, keepdims=True) < 0, -1.0, 1.0)
    out = q.copy()
    out[1:] *= np.cumprod(sign, axis=0)
    return out
