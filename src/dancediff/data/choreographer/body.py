r"""From landings and torso channels to pelvis, legs, spine and head.

Read first: `dancediff.data.choreographer.walk`.

The pelvis goes over the foot that carries the weight before the other one lifts, bounces with the
beat and flies in jumps; legs follow by two-bone IK, so a planted foot stays put; the chest counters
the hips; the head looks to the audience, or where the dancer goes.

Symbols (axes: n dancers · f frames · c channels)
    beat    position of each frame on the beat grid         (f,)
    facing  where the body faces, radians                   (f,)
    lean    difference of weight, left minus right, -1..1   (f,)
    root    pelvis position, metres                         (f, 3)
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from dancediff.axes import FPS
from dancediff.data.choreographer.footsteps import OFFSETS, FootPath, Jump
from dancediff.data.choreographer.grid import Grid
from dancediff.data.choreographer.moves import CHANNEL, Genre, Groove
from dancediff.data.choreographer.quaternion import euler
from dancediff.data.choreographer.score import Count
from dancediff.data.choreographer.tracks import warp
from dancediff.data.choreographer.walk import Walk

GRAVITY = 9.81
LEGS = ((1, 4, 7), (2, 5, 8))  # hip, knee, ankle of the left and the right leg
_REACH = 0.992  # of the leg's length; a straighter leg pops at the knee
_LEG = [np.linalg.norm(OFFSETS[k]) + np.linalg.norm(OFFSETS[a]) for _, k, a in LEGS]
_EARLY = 0.14  # beats by which the weight shifts before a foot lifts
_SHARES = (0.35, 0.30, 0.35)  # of a torso bend in belly, spine and chest
_NECK_LIMIT = np.radians(62)


@dataclass(frozen=True)
class Personal:
    """Small differences between the dancers of a group."""

    height: float = 0.0  # metres
    bounce: float = 1.0
    size: float = 1.0
    late: float = 0.0  # beats

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Personal":
        """A dancer's own way."""
        return cls(
            height=rng.uniform(-0.008, 0.008),
            bounce=rng.uniform(0.85, 1.15),
            size=rng.uniform(0.9, 1.1),
            late=rng.uniform(-0.02, 0.02),
        )


@dataclass(frozen=True)
class DancerPart:
    """One dancer's plan and paths; ``track`` are the torso channels frame by frame (f, c)."""

    counts: list[Count]
    walk: Walk
    me: Personal
    track: np.ndarray
    feet: tuple[FootPath, FootPath]
    floor: np.ndarray
    lean: np.ndarray


@dataclass(frozen=True)
class Pelvis:
    """Path of the pelvis; see the module's symbols."""

    root: np.ndarray
    rotation: np.ndarray  # (f, 3, 3)
    turn: np.ndarray  # degrees relative to the facing: pitch, bend, twist  (f, 3)
    lean: np.ndarray


def floor_path(grid: Grid, feet: tuple[FootPath, FootPath], groove: Groove):
    """Where the weight is on the floor, (f, 2), and the difference of weight, (f,)."""
    beat, frames_per_beat = grid.beat, grid.spb * FPS
    shift = groove.shift * np.minimum(grid.swing, 1.0)
    weight = np.stack([np.interp(beat + _EARLY, beat, foot.weight) for foot in feet])
    lean = gaussian_filter1d(weight[0] - weight[1], 0.2 * frames_per_beat, mode="nearest")
    weight = 1 - shift + shift * weight
    weight = weight / weight.sum(0)
    support = [
        foot.ankle[:, (0, 2)] + 0.03 * np.stack([np.sin(foot.yaw), np.cos(foot.yaw)], -1)
        for foot in feet
    ]
    floor = weight[0, :, None] * support[0] + weight[1, :, None] * support[1]
    floor = gaussian_filter1d(floor, 0.27 * frames_per_beat, axis=0, mode="nearest")
    calm = warp(beat, 0.6)  # the weight, too, comes to rest on the beats
    floor = np.stack([np.interp(calm, beat, x) for x in floor.T], -1)
    return floor, np.interp(calm, beat, lean)


def rise_of(beat: np.ndarray, jumps: list[Jump]) -> np.ndarray:
    r"""How high the body flies above its take-off: $\tfrac g2 (\tau-\tau_0)(\tau_1-\tau)$, (f,)."""
    rise = np.zeros(len(beat))
    for jump in jumps:
        inside = np.maximum((beat - jump.start) * (jump.stop - beat), 0) * jump.spb**2
        rise += 0.5 * GRAVITY * inside
    return rise


def pelvis_path(part: DancerPart, genre: Genre, grid: Grid) -> Pelvis:
    """Height and rotation of the pelvis."""
    track, lean, me, groove, beat = part.track, part.lean, part.me, genre.groove, grid.beat
    fpb = grid.spb * FPS
    facing = np.radians(track[:, CHANNEL["face"]])
    down = track[:, CHANNEL["level"]] / 100
    fold = 60 * np.clip(down - 0.04, 0, None)  # who sinks low folds at the hips
    # hips answer the shoulders: they turn a third of the way against them
    turn = np.stack(
        [
            fold - track[:, CHANNEL["tuck"]],
            -(track[:, CHANNEL["roll"]] + groove.hip * lean * grid.swing),
            groove.hip_twist * lean * grid.swing - 0.33 * track[:, CHANNEL["twist"]],
        ],
        -1,
    )
    pitch, bend, twist = np.radians(turn).T
    rotation = euler(pitch, bend, facing + twist)
    side = track[:, CHANNEL["hip"]] / 100
    floor = part.floor + side[:, None] * np.stack([np.cos(facing), -np.sin(facing)], -1)
    wave = 0.5 * (1 + np.cos(2 * np.pi * (beat - me.late)))
    bounce = me.bounce * genre.energy * (groove.bounce * wave + groove.offbeat * (1 - wave))
    bounce = bounce * grid.swing
    wanted = groove.height + me.height - bounce - down
    room = _room(floor, rotation, part.feet)
    # soften only what lies below the target, so that a straightening leg does not snap
    excess = np.maximum(wanted - room, 0)
    width = max(3, round(0.6 * fpb))
    lower = gaussian_filter1d(maximum_filter1d(excess, width), width / 4, mode="nearest")
    height = wanted - np.maximum(lower, excess)
    height = _with_jumps(beat, height, room, part.walk.jumps, groove.height + 0.025)
    root = np.stack([floor[:, 0], height, floor[:, 1]], -1)
    return Pelvis(root, rotation, turn, lean)


def _room(floor, rotation, feet) -> np.ndarray:
    """How high the pelvis can be so that both legs reach their feet, (f,)."""
    room = np.full(len(floor), np.inf)
    for (hip, _, _), leg, foot in zip(LEGS, _LEG, feet, strict=True):
        out = rotation @ OFFSETS[hip]
        away = floor + out[:, (0, 2)] - foot.ankle[:, (0, 2)]
        drop = np.sqrt(np.maximum((_REACH * leg) ** 2 - (away**2).sum(-1), 0.04))
        room = np.minimum(room, foot.ankle[:, 1] + drop - out[:, 1])
    return room


def _with_jumps(beat, height, room, jumps: list[Jump], top: float) -> np.ndarray:
    """Crouch, take off, fly under gravity, land and give way."""
    from scipy.interpolate import CubicHermiteSpline

    height = height.copy()
    slope = np.gradient(height, beat) if len(beat) > 1 else np.zeros(1)
    for jump in jumps:
        spb = jump.spb
        flight = (jump.stop - jump.start) * spb
        speed = 0.5 * GRAVITY * flight * spb  # metres a beat
        top_here = min(top, *np.interp([jump.start, jump.stop], beat, room)) - 0.005
        dip = min(0.11, 0.05 + 0.2 * flight)
        push = min(0.27, 0.26 / spb)
        time = jump.start + np.array([-push - 0.55, -push, 0.0])
        time = np.concatenate([time, jump.stop + np.array([0.0, push, push + 0.55])])
        ends = np.interp(time[[0, -1]], beat, height)
        slopes = np.interp(time[[0, -1]], beat, slope)
        values = [ends[0], top_here - dip, top_here, top_here, top_here - dip, ends[1]]
        speeds = [slopes[0], 0, speed, -speed, 0, slopes[1]]
        near = (beat > time[0]) & (beat < time[-1])
        stand = CubicHermiteSpline(time, values, speeds)(beat[near])
        height[near] = np.minimum(stand, room[near])
        fly = (beat >= jump.start) & (beat <= jump.stop)
        height[fly] = top_here + rise_of(beat[fly], [jump])
    return height


def spine(part: DancerPart, genre: Genre, pelvis: Pelvis, grid: Grid) -> np.ndarray:
    """Belly, spine, chest, neck and head rotations, (f, 5, 3, 3)."""
    beat = grid.beat
    track, groove, energy, lag = part.track, genre.groove, genre.energy, genre.style.lag
    early, late = (  # a movement runs up the back
        np.stack([np.interp(beat + d, beat, x) for x in track.T], -1) for d in (lag, -lag)
    )
    wave = 0.5 * (1 + np.cos(2 * np.pi * (beat - part.me.late)))
    lean_bend = -groove.sway * pelvis.lean * grid.swing
    size = part.me.size * energy
    total = []
    for shift, x in ((0.09, early), (0.0, track), (-0.09, late)):
        rock = groove.rock * np.interp(beat + shift, beat, wave) * energy * grid.swing
        pitch = size * x[:, CHANNEL["pitch"]] + rock + 0.35 * pelvis.turn[:, 0]
        bend = size * x[:, CHANNEL["bend"]] + lean_bend
        total.append(np.stack([pitch, bend, size * x[:, CHANNEL["twist"]]], -1) - pelvis.turn)
    rib, pop = (size * track[:, CHANNEL[name]] for name in ("rib", "pop"))
    joints = [share * turn for share, turn in zip(_SHARES, total, strict=True)]
    joints[0] = joints[0] + np.stack([0.8 * pop, rib, 0 * rib], -1)
    joints[2] = joints[2] - np.stack([pop, 1.1 * rib, 0 * rib], -1)
    chest = sum(joints) + pelvis.turn
    head = _head(track, chest)
    angles = np.radians(np.stack([*joints, 0.45 * head, 0.55 * head], 1))  # (f, 5, 3)
    return euler(angles[..., 0], angles[..., 1], angles[..., 2])


def _head(track: np.ndarray, chest: np.ndarray) -> np.ndarray:
    """Head relative to the chest, degrees (f, 3): towards the audience, and round last in turns."""
    facing = np.radians(track[:, CHANNEL["face"]])
    # the eyes stay in front while the neck can follow, then whip round
    ahead = -np.arctan2(np.sin(facing), np.cos(facing))
    follow = 0.8 * np.clip((2.7 - np.abs(ahead)) / 0.9, 0, 1)
    spot = np.clip(ahead, -_NECK_LIMIT, _NECK_LIMIT) * follow
    yaw = np.degrees(spot) - 0.85 * chest[:, 2] + track[:, CHANNEL["look"]]
    yaw = gaussian_filter1d(62 * np.tanh(yaw / 62), 1.5, mode="nearest")
    pitch = -0.75 * chest[:, 0] + track[:, CHANNEL["nod"]]
    return np.stack([pitch, -0.7 * chest[:, 1] + track[:, CHANNEL["tilt"]], yaw], -1)
