r"""Footsteps: which foot lands where on which beat, and how it gets there.

Read first: `dancediff.motion.contact`.

A foot is led by the ball of its toes. Standing, nothing moves. To step, the heel peels off while
the toes still stand, then the foot travels; in a turn the toes stay and the heel goes round them.
Contacts are read off the planned path, so they are exact.

Symbols (axes: f frames · s landings of one foot)
    beat    position of each frame on the beat grid (2.5 = half way between beats 2 and 3)   (f,)
    ankle   path of one ankle on stage, metres                                               (f, 3)
    pitch   how far the foot points down, radians                                            (f,)
    facing  where the body faces, radians                                                    (f,)
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from dancediff.motion.contact import CONTACT_HEIGHT
from dancediff.motion.skeleton import SMPL24

SWING = 0.72  # beats a foot is in the air, at most
PUSH = 0.34  # beats in which the heel rises before a jump
PEEL = 0.2  # share of a swing in which only the heel rises
TOE_HEIGHT = 0.02  # metres, the toe joint of a standing foot
PIVOT = np.radians(38)  # a body that turns further than this takes the standing foot along
STILL = 1.6e-3  # metres a frame; a foot joint that moves less is planted
LEAD = 0.22  # beats by which a landing foot is ahead of a turning body
WEIGHT = {"step": 1.0, "ball": 1.0, "jump": 1.0, "leap": 1.0, "tap": 0.3, "heel": 0.3, "air": 0.05}
TILT = {"tap": 0.5, "heel": -0.42, "ball": 0.48}  # radians a foot is pitched as it stands
OFFSETS = SMPL24.offsets.numpy().astype(np.float64)  # of joints from their parents, metres
TOES = {"L": OFFSETS[10], "R": OFFSETS[11]}


@dataclass(frozen=True)
class Step:
    """One landing: the foot is at ``place`` (ankle, x and z) from ``beat`` on."""

    beat: float
    place: np.ndarray
    how: str = "step"
    height: float = 0.0  # metres above the floor
    lift: float = 0.08
    behind: float = 0.0  # metres; a foot lifted behind the body shows its sole
    yaw: float = 0.0  # radians relative to the body, with the toe-out
    bow: np.ndarray = field(default_factory=lambda: np.zeros(2))  # metres aside, on the way here


@dataclass(frozen=True)
class FootPath:
    """What one foot does in every frame; see the module's symbols."""

    ankle: np.ndarray
    yaw: np.ndarray
    pitch: np.ndarray
    flex: np.ndarray  # toes bent up against the sole, radians
    weight: np.ndarray  # how much this foot wants to carry, 0..1
    planted: np.ndarray  # ankle and toe, (f, 2) of bool


@dataclass(frozen=True)
class Jump:
    """A flight from beat ``start`` to beat ``stop``, where a beat lasts ``spb`` seconds."""

    start: float
    stop: float
    spb: float


def smoothstep(u: np.ndarray) -> np.ndarray:
    r"""$6u^5 - 15u^4 + 10u^3$: from 0 to 1 with no speed and no force at the ends.

    >>> smoothstep(np.array([0.0, 0.5, 1.0])).tolist()
    [0.0, 0.5, 1.0]
    """
    u = np.clip(u, 0, 1)
    return u * u * u * (u * (6 * u - 15) + 10)


def time_steps(steps: dict[str, list[Step]], jumps: list[Jump]) -> dict[str, np.ndarray]:
    """When each foot leaves each landing, so that the other one stands by then.

    Shapes: s landings -> (s - 1, 2) per foot: the beat, and the share of the swing in which only
    the heel rises.
    """
    landed = {foot: np.array([s.beat for s in steps[foot] if s.height == 0]) for foot in "LR"}
    leave = {}
    for foot, other in ("LR", "RL"):
        out = np.full((len(steps[foot]) - 1, 2), PEEL)
        for i, (a, b) in enumerate(pairwise(steps[foot])):
            before = landed[other][landed[other] < b.beat - 1e-6]
            soon = max(b.beat - SWING, a.beat + 0.06, before[-1] - 0.04 if len(before) else -9.0)
            out[i, 0] = a.beat if a.height > 0 else max(min(soon, b.beat - 0.3), a.beat + 0.02)
            for jump in jumps:  # a foot that stands is off the floor exactly when the body is
                if a.height == 0 and a.beat < jump.start and b.beat >= jump.stop - 1e-6:
                    heel = max(jump.start - PUSH, a.beat + 0.02)
                    out[i] = heel, (jump.start - heel) / (b.beat - heel)
        leave[foot] = out
    return leave


def foot_path(beat, steps: list[Step], leave, facing, foot: str, rise, point: float) -> FootPath:
    """Turn the landings of one foot (in time order, the first is where it begins) into a path.

    ``rise`` is how high the body flies in each frame, metres (f,); a foot off the floor flies too.
    """
    off = TOES[foot]
    time = np.array([s.beat for s in steps])
    place = np.array([s.place for s in steps])
    height = TOE_HEIGHT + np.array([s.height for s in steps])
    tilt = np.array([_tilt(s, point) for s in steps])
    height = height - np.where(tilt < 0, off[2] * np.sin(tilt), 0)  # a heel dig lifts the toes
    air = np.array([s.how == "air" for s in steps])
    end, peel_share = np.append(leave, [[np.inf, PEEL]], axis=0).T

    i = np.clip(np.searchsorted(time, beat, "right") - 1, 0, None)
    j = np.minimum(i + 1, len(steps) - 1)
    swing = beat > end[i]
    u = np.where(swing, (beat - end[i]) / np.maximum(time[j] - end[i], 1e-6), 0.0)
    first = peel_share[i]
    v = np.where(air[i], u, np.clip((u - first) / (1 - first), 0, 1))
    s = smoothstep(v)

    # facing when each landing happens, and when the foot leaves again
    landing = np.interp(time + np.where(air, 0, LEAD), beat, facing)
    began, ended = (np.interp(np.minimum(x, beat[-1]), beat, facing) for x in (time, end))
    pivots = (np.abs(ended - began) > PIVOT) | air
    own = np.array([s.yaw for s in steps])
    yaw_in = landing + own
    yaw_out = yaw_in + np.where(pivots, ended - began, 0)
    standing = yaw_in[i] + np.where(pivots[i], facing - began[i], 0)
    yaw = np.where(swing, yaw_out[i] + (yaw_in[j] - yaw_out[i]) * s, standing)

    # a pivoting foot stands on its ball
    ball = 0.46 * smoothstep(np.abs(np.gradient(facing, beat)) / 0.7)
    on_ball = np.where(pivots & ~air, 1.0, 0.0)
    pitch_in, pitch_out = (
        np.where(tilt < 0, tilt, np.maximum(tilt, on_ball * np.interp(x, beat, ball)))
        for x in (time, np.minimum(end, beat[-1]))
    )
    standing = np.where(tilt[i] < 0, tilt[i], np.maximum(tilt[i], on_ball[i] * ball))
    peel = smoothstep(u / (1.7 * first)) * (1 - smoothstep((u - 1.5 * first) / (1 - 1.5 * first)))
    peel = peel * (0.25 + point) * np.where(air[i] | air[j], 0.3, 1.0)
    base = pitch_out[i] + (pitch_in[j] - pitch_out[i]) * s
    pitch = np.where(swing, base + peel * (1 - np.clip(base, 0, 1)), standing)

    # the toes are placed, the ankle follows from the foot's pitch and yaw
    toes = place + _sole(off, yaw_in, 0 * yaw_in)[:, (0, 2)]
    bow = np.array([step.bow for step in steps])
    aside = np.sin(np.pi * s) * swing
    toe = np.empty((len(beat), 3))
    toe[:, (0, 2)] = toes[i] + (toes[j] - toes[i]) * s[:, None] + bow[j] * aside[:, None]
    arc = np.sin(np.pi * v) ** 1.3 * swing * np.array([step.lift for step in steps])[j]
    flown = np.where((v > 0) | air[i], rise, 0)
    toe[:, 1] = height[i] + (height[j] - height[i]) * s + arc + flown
    ankle = toe - _sole(off, yaw, pitch)

    carry = np.array([WEIGHT[step.how] for step in steps])
    weight = np.where(swing, 0.2 + (carry[j] - 0.2) * s**4, carry[i])
    flat = np.where(air[i], 0.0, np.clip(1 - 6 * v, 0, 1))  # toes lie on the floor
    planted = np.stack([_planted(ankle, CONTACT_HEIGHT[0]), _planted(toe, CONTACT_HEIGHT[2])], -1)
    return FootPath(ankle, yaw, pitch, np.clip(pitch, 0, None) * flat, weight, planted)


def _tilt(step: Step, point: float) -> float:
    """Radians a foot is pitched where it has arrived."""
    hangs = point * (1.7 + 3.0 * step.behind) if step.how == "air" else 0.0
    return TILT.get(step.how, hangs)


def _sole(off, yaw, pitch) -> np.ndarray:
    """From ankle to toe: $R_y R_x$ times the rest offset, (f, 3)."""
    y = off[1] * np.cos(pitch) - off[2] * np.sin(pitch)
    z = off[1] * np.sin(pitch) + off[2] * np.cos(pitch)
    return np.stack(
        [off[0] * np.cos(yaw) + z * np.sin(yaw), y, z * np.cos(yaw) - off[0] * np.sin(yaw)], -1
    )


def _planted(path: np.ndarray, low: float) -> np.ndarray:
    """Low, and still until the next frame; (f, 3) -> (f,)."""
    step = np.linalg.norm(np.diff(path, axis=0), axis=-1)
    step = np.append(step, step[-1:] if len(step) else 0.0)
    return (step < STILL) & (path[:, 1] < low - 1e-4)
