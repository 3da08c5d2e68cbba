r"""Music for silent motion: songs whose beats follow the dance, instead of the other way round.

Read first: `dancediff.motion.beats` · `dancediff.music.synth`.

The beats of a group's motion are the moments where it comes to rest (`motion_beats`). A tempo map
is a row of beats that meets as many of them as it can while its tempo changes only gradually; the
synthesiser then plays on it. Such music is called "beat-aligned synthetic" in every table: it shows
a network how dance meets beats, not what people dance to.

Symbols (axes: f frames · m music features)
    rest      how clearly the group comes to rest in a frame, 0..1   (f,)
    interval  frames from one beat to the next
    beats     of the song, seconds                                   (k,)
"""

from dataclasses import replace
from functools import partial
from hashlib import sha256

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d
from scipy.signal import peak_prominences
from torch import Tensor

from dancediff.axes import FPS
from dancediff.data.cache import song_features
from dancediff.data.take import DanceTake, Job
from dancediff.motion.beats import mean_speed, motion_beats
from dancediff.motion.motion import Motion
from dancediff.music.features import BEATS, LATE
from dancediff.music.synth import synth_on_beats

INTERVALS = np.arange(10, 25)  # frames: 180 to 75 beats a minute
SHORTEST_DANCE = 60  # frames in which a tempo can be found
_WIDTH = 1.0  # frames: how far beside a rest a beat still counts
_MISSED = 0.35  # cost of a beat where nobody comes to rest
_CHANGE = 0.06  # cost of a change of the interval by one frame; grows with its square
_LARGEST = 2  # frames by which the interval may change from one beat to the next
_STIFF = 0.5  # how far evenness may move a beat away from its frame


def rest_curve(joints: Tensor) -> np.ndarray:
    """How clearly a whole group comes to rest in every frame, 0..1.

    A bump at every beat of the motion, as high as the speed falls there.

    Shapes: joints (n, f, j, 3) metres -> (f,).

    >>> float(rest_curve(torch.zeros(2, 90, 24, 3)).max())
    0.0
    """
    group = joints.transpose(0, 1).flatten(1, 2)
    frames = motion_beats(group)
    rest = np.zeros(len(group))
    if len(frames) == 0:
        return rest
    speed = gaussian_filter1d(mean_speed(group), 1.5, mode="nearest")
    depth = peak_prominences(-speed, frames)[0]
    rest[frames] = np.minimum(depth / max(float(np.median(depth)), 1e-9), 1)
    bump = gaussian_filter1d(np.eye(1, 15, 7)[0], _WIDTH)
    return np.minimum(np.convolve(rest, bump / bump.max(), mode="same"), 1)


def tempo_map(rest: np.ndarray) -> np.ndarray:
    r"""Beats that meet the rests of a dance, with a tempo that changes only gradually.

    $$\max_{b} \sum_k r(b_k) - c_0 - c_1 (\Delta_k - \Delta_{k-1})^2,\quad
      \Delta_k = b_k - b_{k-1}$$

    solved exactly by dynamic programming over (frame, interval), then smoothed below the length of
    a frame.  Source: the idea of Ellis' beat tracker.  Differs: that one knows one tempo a song.

    Shapes: rest (f,) -> (k,) seconds.
    Raises: ValueError when there are fewer than 60 frames.

    >>> rest = np.zeros(300)
    >>> rest[7::15] = 1                                   # a rest every half second
    >>> tempo_map(rest)[:3].round(2).tolist()
    [0.23, 0.73, 1.23]
    """
    if len(rest) < SHORTEST_DANCE:
        raise ValueError(
            f"{len(rest)} frames are too few to find a tempo in, at least {SHORTEST_DANCE}; a take "
            "with a song of its own needs none"
        )
    frames = _best_row(rest)
    weight = np.diag(rest[frames] + 0.05)
    bend = np.diff(np.eye(len(frames)), 2, axis=0)  # second differences: changes of the interval
    even = np.linalg.solve(weight + _STIFF * bend.T @ bend, weight @ frames)
    return np.maximum(even, 0.0) / FPS


def _best_row(rest: np.ndarray) -> np.ndarray:
    """Frames of the best row of beats."""
    f, k = len(rest), len(INTERVALS)
    moves = np.arange(-_LARGEST, _LARGEST + 1)
    before = np.clip(np.arange(k)[:, None] + moves, 0, k - 1)  # interval before, for each change
    cost = _CHANGE * (before - np.arange(k)[:, None]) ** 2
    # about 110 beats a minute unless the motion says otherwise
    prior = 0.3 * np.log2(INTERVALS / 16.5) ** 2
    gain = rest - _MISSED
    total = gain[:, None] - prior
    came = np.full((f, k), -1)  # which interval led to the beat before; -1: none before
    for at in range(INTERVALS[0], f):
        last = at - INTERVALS
        ready = last >= 0
        options = total[last[:, None], before] - cost
        best = options.argmax(1)
        value = options[np.arange(k), best]
        # a row may only begin near the start: later beats need one before them
        go = ready & ((value > 0) | (last >= INTERVALS[-1]))
        total[at, go] += value[go]
        came[at, go] = before[np.arange(k), best][go]
    at = f - INTERVALS[-1] + int(total[f - INTERVALS[-1] :].max(1).argmax())
    interval = int(total[at].argmax())
    row = [at]
    while came[at, interval] >= 0:
        at, interval = at - INTERVALS[interval], came[at, interval]
        row.append(at)
    return np.array(row[::-1])


def soundtrack(motion: Motion, *, seed: int = 0, songs: int = 3) -> tuple[Tensor, np.ndarray]:
    """Features of several songs, each with its own band and mix, on the beats of one dance.

    The column of beats holds the beats that were played, `LATE` as in any song.  Differs from what
    a listener finds: librosa's tracker expects one tempo a song, and loses songs that follow a
    dance.

    Shapes: -> M (songs, f, m), beats (k,) seconds.
    Raises: ValueError when the dance is shorter than 2 seconds, or ``songs`` not positive.

    >>> still = Motion(torch.eye(3).expand(1, 90, 24, 3, 3), torch.zeros(1, 90, 3))
    >>> M, beats = soundtrack(still, songs=1)
    >>> M.shape, int(M[0, :, BEATS].sum()) >= len(beats) - 1  # the last may come too late
    (torch.Size([1, 90, 35]), True)
    """
    if songs < 1:
        raise ValueError(f"songs={songs} must be at least 1")
    f = motion.num_frames
    grid = tempo_map(rest_curve(motion.joints()))
    seeds = np.random.default_rng(seed).integers(2**31, size=songs)
    rows = []
    for one in seeds:
        song, truth = synth_on_beats(grid, int(one), seconds=f / FPS + 0.1)
        rows.append(song_features(song)[:f].clone())
    beats = truth.beats[np.round(truth.beats * FPS) < f]
    frames = np.round((beats + LATE) * FPS).astype(int)
    M = torch.stack(rows)
    M[:, :, BEATS] = 0
    M[:, frames[frames < f], BEATS] = 1
    return M, beats


def with_soundtrack(take: DanceTake, *, songs: int = 3) -> DanceTake:
    """The same take with beat-aligned synthetic music, drawn by the take's name.

    ``notes`` tells which share of the song's beats the motion meets within two frames.
    """
    seed = int.from_bytes(sha256(take.name.encode()).digest()[:4])
    M, beats = soundtrack(take.motion, seed=seed, songs=songs)
    rests = motion_beats(take.motion.joints().transpose(0, 1).flatten(1, 2))
    gaps = np.abs(beats[:, None] * FPS - rests[None]).min(1, initial=np.inf)
    return replace(
        take,
        music="beat-aligned synthetic",
        M=M[0],
        M_other=M[1:] if songs > 1 else None,
        beats=beats,
        notes=take.notes | {"beats_met": round(float((gaps <= 2).mean()), 4)},
    )


def soundtrack_jobs(jobs: list[Job], *, songs: int = 3) -> list[Job]:
    """The same jobs; their takes get music if they have none."""
    return [Job(job.name, partial(_make, job.make, songs)) for job in jobs]


def _make(make, songs: int) -> DanceTake:
    take = make()
    return take if take.M is not None else with_soundtrack(take, songs=songs)
