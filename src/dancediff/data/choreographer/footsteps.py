r"""Footsteps: which foot lands where on which beat, and how it gets there.

A planted foot does not move. A swinging foot leaves the floor ``SWING`` beats before it lands,
rises in an arc and travels along a straight line, slow at both ends.

Symbols (axes: f frames)
    beat    position of each frame on the beat grid (2.5 = half way between beats 2 and 3)   (f,)
    ankle   path of one ankle on stage, metres                                               (f, 3)
    pitch   how far the foot points down, radians                                            (f,)
    planted foot stands flat on the floor                                                    (f,)
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

SWING = 0.72  # beats a foot is in the air
ANKLE_HEIGHT = 0.08  # metres, standing flat; the toe joint is then at 0.02


@dataclass(frozen=True)
class Step:
    """One footfall: the foot is at ``place`` (x, z) from ``beat`` on, after rising ``lift``."""

    beat: float
    place: np.ndarray
    yaw: float
    lift: float = 0.09


@dataclass(frozen=True)
class FootPath:
    """What one foot does in every frame; see the module's symbols."""

    ankle: np.ndarray
    yaw: np.ndarray
    pitch: np.ndarray
    planted: np.ndarray


def smoothstep(u: np.ndarray) -> np.ndarray:
    r"""$6u^5 - 15u^4 + 10u^3$: from 0 to 1 with no speed and no force at the ends.

    >>> smoothstep(np.array([0.0, 0.5, 1.0])).tolist()
    [0.0, 0.5, 1.0]
    """
    u = np.clip(u, 0, 1)
    return u * u * u * (u * (6 * u - 15) + 10)


def foot_path(beat: np.ndarray, steps: list[Step]) -> FootPath:
    """Turn a list of footfalls (in time order, the first is where the foot starts) into a path."""
    f = len(beat)
    ankle = np.empty((f, 3))
    ankle[:, 1] = ANKLE_HEIGHT
    ankle[:, (0, 2)] = steps[0].place
    yaw = np.full(f, steps[0].yaw)
    pitch = np.zeros(f)
    planted = np.ones(f, dtype=bool)
    for before, step in pairwise(steps):
        start = max(step.beat - SWING, before.beat + 0.05)
        later = beat > start
        u = (beat[later] - start) / (step.beat - start)
        s = smoothstep(u)
        ankle[later, 0] = before.place[0] + s * (step.place[0] - before.place[0])
        ankle[later, 2] = before.place[1] + s * (step.place[1] - before.place[1])
        yaw[later] = before.yaw + s * (step.yaw - before.yaw)
        arc = np.where(u < 1, np.sin(np.pi * np.clip(u, 0, 1)), 0)
        ankle[later, 1] = ANKLE_HEIGHT + step.lift * arc
        # heel first off, toes up a little before landing
        pitch[later] = np.where(u < 1, 0.30 * np.sin(2 * np.pi * np.clip(u, 0, 1)) * arc, 0)
        planted[later] = u >= 1
    return FootPath(ankle, yaw, pitch, planted)
