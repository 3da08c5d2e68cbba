r"""`choreograph`: an endless supply of labelled group dances.

Read first: notebook 03.

Everything is planned on the beat grid (score.py), walked by planned footsteps (footsteps.py) and
carried by a body (body.py). The truth comes with it: contacts, beats, formations, order.
Every number measured on these dances is a number about synthetic data.
"""

import operator
from dataclasses import dataclass

import numpy as np
import torch

from dancediff.data.choreographer.body import Groove, arm_rotations, assemble, torso_rotations
from dancediff.data.choreographer.footsteps import foot_path
from dancediff.data.choreographer.formations import min_distance
from dancediff.data.choreographer.score import PHRASE, Score, footsteps, write_score
from dancediff.motion.motion import Motion

FPS = 30
MAX_DANCERS = 5
MIN_ROOT_DISTANCE = 0.5  # metres; a dance that comes closer is drawn again


@dataclass(frozen=True)
class DanceTruth:
    """What the choreographer knows about its dance.

    beats        frames on which a beat falls                        (k,)
    contacts     foot planted, by plan                               (n, f, 4)
    formations   (frame, name, slots (n, 2) metres by dancer)
    order_start  dancers from left to right in the first frame       (n,)
    order_end    the same in the last frame                          (n,)
    """

    beats: np.ndarray
    contacts: torch.Tensor
    formations: list[tuple[int, str, np.ndarray]]
    order_start: np.ndarray
    order_end: np.ndarray


def choreograph(beats, *, dancers: int = 3, seed: int = 0, seconds: float | None = None):
    """Make a group dance on a beat grid.

    Shapes: beats (k,) seconds, increasing -> Motion (n dancers, round(seconds * 30) frames),
    DanceTruth. ``seconds`` defaults to the time of the last beat.
    Raises: ValueError naming the argument when the grid has fewer than 4 beats or is not
    increasing, or when dancers is not 1..5.

    >>> dance, truth = choreograph(np.arange(0.2, 8, 0.5), dancers=2, seed=1)
    >>> dance.num_dancers, dance.num_frames, truth.contacts.shape
    (2, 231, torch.Size([2, 231, 4]))
    """
    beats = np.asarray(beats, dtype=np.float64)
    dancers = operator.index(dancers)
    if not 1 <= dancers <= MAX_DANCERS:
        raise ValueError(f"dancers={dancers} is not in 1..{MAX_DANCERS}")
    if beats.ndim != 1 or len(beats) < 4 or not (np.diff(beats) > 0).all():
        raise ValueError("beats must be at least 4 increasing times in seconds")
    seconds = float(beats[-1]) if seconds is None else float(seconds)
    if not seconds > 0:
        raise ValueError(f"seconds={seconds} must be positive")
    num_frames = max(1, round(seconds * FPS))
    beat = beat_position(beats, num_frames)
    rng = np.random.default_rng(seed)
    while True:
        score = write_score(dancers, int(np.ceil(beat[-1])) + 2, rng)
        parts = [_dance(score, i, beat, beats, rng) for i in range(dancers)]
        root = torch.stack([part[1] for part in parts])
        if min_distance(root[..., (0, 2)].numpy()) > MIN_ROOT_DISTANCE:
            break
    contacts = torch.stack([part[2] for part in parts])
    motion = Motion(
        torch.stack([part[0] for part in parts]),
        root,
        FPS,
        contact=contacts,
        meta={"source": "choreographer", "seed": int(seed), "synthetic": True},
    )
    return motion, _truth(motion, score, beat, beats, contacts)


def beat_position(beats: np.ndarray, num_frames: int) -> np.ndarray:
    """Where each frame lies on the beat grid, carried on evenly beyond its ends, (f,).

    The grid is shifted so that every frame lies after beat 1: steps may begin before the clip.

    >>> beat_position(np.array([0.5, 1.0, 1.5, 2.0]), 31)[[0, 15, 30]].tolist()
    [1.0, 2.0, 3.0]
    """
    time = np.arange(num_frames) / FPS
    index = np.arange(len(beats), dtype=np.float64)
    first, last = beats[1] - beats[0], beats[-1] - beats[-2]
    at = np.interp(time, beats, index)
    at = np.where(time < beats[0], (time - beats[0]) / first, at)
    at = np.where(time > beats[-1], index[-1] + (time - beats[-1]) / last, at)
    return at + max(0, int(np.ceil(1 - at[0])))


def _dance(score: Score, i: int, beat, beats, rng):
    groove = Groove.draw(rng)
    steps = footsteps(score, i)
    feet = (foot_path(beat, steps["L"]), foot_path(beat, steps["R"]))
    keys = _body_keys(score, i, groove)
    frames_per_beat = float(np.median(np.diff(beats))) * FPS
    pose, root = assemble(beat, np.zeros(len(beat)), feet, keys, groove, frames_per_beat)
    planted = np.stack([foot.planted for foot in feet] * 2, -1)
    return pose, root, torch.from_numpy(planted).float()


def _body_keys(score: Score, i: int, groove: Groove) -> torch.Tensor:
    left, right, torso = [], [], []
    for move, within, flip in score.moves[i]:
        a, b = move.left[within % PHRASE], move.right[within % PHRASE]
        pitch, bend, twist = move.torso[within % PHRASE]
        left.append(b if flip else a)
        right.append(a if flip else b)
        torso.append((pitch, -bend if flip else bend, -twist if flip else twist))
    return torch.cat(
        [
            torso_rotations(np.array(torso, dtype=np.float64), groove.size),
            arm_rotations(left, 1, groove.arms),
            arm_rotations(right, -1, groove.arms),
        ],
        dim=1,
    )


def _truth(motion: Motion, score: Score, beat, beats, contacts) -> DanceTruth:
    frames = np.round(beats * FPS).astype(int)
    x = motion.root[..., 0].numpy()
    formations = []
    for at, name, place in score.formations:
        frame = 0 if at == 0 else int(np.searchsorted(beat, at))
        if frame < motion.num_frames:
            formations.append((frame, name, place))
    return DanceTruth(
        beats=frames[(frames >= 0) & (frames < motion.num_frames)],
        contacts=contacts,
        formations=formations,
        order_start=np.argsort(x[:, 0]),
        order_end=np.argsort(x[:, -1]),
    )
