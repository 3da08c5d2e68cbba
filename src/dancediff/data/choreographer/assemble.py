r"""One body per dancer: paths first, then all joints of all dancers at once.

Read first: `dancediff.data.choreographer.body` and `dancediff.data.choreographer.arms`.

Symbols (axes: n dancers · f frames · c channels)
    pose  joint rotations relative to the parent    (n, f, 24, 3, 3)
    root  pelvis position, metres                   (n, f, 3)
"""

import numpy as np
import torch

from dancediff.data.choreographer.arms import arm_matrices, arm_track, elbow_room, mixed
from dancediff.data.choreographer.body import (
    LEGS,
    DancerPart,
    Pelvis,
    Personal,
    floor_path,
    pelvis_path,
    rise_of,
    spine,
)
from dancediff.data.choreographer.breath import CALM
from dancediff.data.choreographer.footsteps import OFFSETS, foot_path, time_steps
from dancediff.data.choreographer.grid import Grid
from dancediff.data.choreographer.moves import CHANNEL, Genre
from dancediff.data.choreographer.poses import ARM_JOINTS
from dancediff.data.choreographer.quaternion import euler
from dancediff.data.choreographer.score import Score
from dancediff.data.choreographer.tracks import count_track, smoothed
from dancediff.data.choreographer.walk import plan_walk
from dancediff.motion.ik import two_bone_ik
from dancediff.motion.skeleton import SMPL24

_FACE = CHANNEL["face"]
_SPINE = tuple(SMPL24.index(name) for name in ("belly", "spine", "chest", "neck", "head"))


def plan_parts(score: Score, genre: Genre, grid: Grid, reach: float, seeds) -> list[DancerPart]:
    """Feet and floor paths of all dancers; cheap, so that it can be tried with smaller steps."""
    parts, beat = [], grid.beat
    for i, seed in enumerate(seeds):
        walk = plan_walk(score, i, genre.style, grid.pace, reach)
        track = smoothed(count_track(walk.on, walk.off, beat, genre.style), genre.style.smooth, 0)
        if grid.gaps:
            slow = smoothed(count_track(walk.on, walk.off, beat, CALM), CALM.smooth, 0)
            track += grid.calm[:, None] * (slow - track)
        track[:, _FACE] = _facing(walk.on[:, _FACE], beat)
        rise = rise_of(beat, walk.jumps)
        leave = time_steps(walk.steps, walk.jumps)
        facing = np.radians(track[:, _FACE])
        left, right = (
            foot_path(beat, walk.steps[s], leave[s], facing, s, rise, genre.style.point)
            for s in "LR"
        )
        feet = left, right
        floor, lean = floor_path(grid, feet, genre.groove)
        me = Personal.draw(np.random.default_rng(seed))
        parts.append(DancerPart(score.counts[i], walk, me, track, feet, floor, lean))
    return parts


def _facing(face: np.ndarray, beat: np.ndarray) -> np.ndarray:
    """Degrees the body faces: even turns, without a stop on every count; exactly still between."""
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(np.arange(len(face)), face)(beat)


def assemble(dance: list[DancerPart], genre: Genre, grid: Grid):
    """Whole bodies: pose (n, f, 24, 3, 3), root (n, f, 3) and contacts (n, f, 4), as tensors."""
    n, f = len(dance), len(grid.beat)
    pose = np.zeros((n, f, 24, 3, 3))
    pose[...] = np.eye(3)
    pelvises = [_trunk(part, pose[i], genre, grid) for i, part in enumerate(dance)]
    root = np.stack([p.root for p in pelvises])
    pose[:, :, 0] = np.stack([p.rotation for p in pelvises])
    _legs(pose, root, dance)
    room = elbow_room(np.stack([part.floor for part in dance]))
    arms = np.stack(
        [_arms(part, genre, grid, free) for part, free in zip(dance, room, strict=True)]
    )
    shrug = np.stack([part.track[:, CHANNEL["shrug"]] for part in dance])
    R = arm_matrices(arms, shrug, _seen_from_chest(pose))
    for s, joints in enumerate(ARM_JOINTS):
        pose[:, :, joints] = R[:, s]
    planted = np.stack([[foot.planted for foot in part.feet] for part in dance])  # (n, 2, f, 2)
    contacts = np.moveaxis(planted, 2, 1).swapaxes(2, 3).reshape(n, f, 4)
    return tuple(torch.from_numpy(x.astype(np.float32)) for x in (pose, root, contacts))


def _trunk(part: DancerPart, pose: np.ndarray, genre: Genre, grid: Grid) -> Pelvis:
    """Pelvis, spine and head of one dancer; writes the spine into ``pose``."""
    pelvis = pelvis_path(part, genre, grid)
    pose[:, _SPINE] = spine(part, genre, pelvis, grid)
    return pelvis


def _arms(part: DancerPart, genre: Genre, grid: Grid, room: np.ndarray) -> list[np.ndarray]:
    """Both arms of one dancer in the genre's style, and calmly where there is no beat."""
    beat = grid.beat + part.me.late
    arms = [arm_track(part.counts, s, beat, genre.style, room) for s in (1, -1)]
    if grid.gaps:
        slow = [arm_track(part.counts, s, beat, CALM, room) for s in (1, -1)]
        arms = [mixed(a, b, 1 - grid.calm) for a, b in zip(arms, slow, strict=True)]
    return arms


def _legs(pose: np.ndarray, root: np.ndarray, dance: list[DancerPart]) -> None:
    """Hips, knees, ankles and toes of all dancers, by two-bone IK."""
    facing = pose[:, :, 0]
    for s, (hip, knee, ankle) in enumerate(LEGS):
        feet = [part.feet[s] for part in dance]
        yaw, pitch, flex = (
            np.stack([getattr(x, k) for x in feet]) for k in ("yaw", "pitch", "flex")
        )
        target = np.stack([x.ankle for x in feet])
        hip_at = root + facing @ OFFSETS[hip]
        pole = np.stack([np.sin(yaw), 0.25 + 0 * yaw, np.cos(yaw)], -1)
        thigh, shin, _ = two_bone_ik(
            torch.from_numpy(hip_at), torch.from_numpy(target), torch.from_numpy(pole),
            SMPL24.offsets[knee].double(), SMPL24.offsets[ankle].double(),
        )  # fmt: skip
        thigh, shin = thigh.numpy(), shin.numpy()
        sole = euler(pitch, 0.0, yaw)
        pose[:, :, hip] = np.swapaxes(facing, -1, -2) @ thigh
        pose[:, :, knee] = np.swapaxes(thigh, -1, -2) @ shin
        pose[:, :, ankle] = np.swapaxes(shin, -1, -2) @ sole
        pose[:, :, ankle + 3] = euler(-flex, 0.0, 0.0)


def _seen_from_chest(pose: np.ndarray) -> np.ndarray:
    """Pelvis, hips and knees in the chest's frame, (n, f, 5, 3)."""
    belly, spine, chest = (SMPL24.index(name) for name in ("belly", "spine", "chest"))
    up = pose[:, :, belly] @ pose[:, :, spine]  # from the pelvis to the spine
    at = OFFSETS[belly] + pose[:, :, belly] @ OFFSETS[spine] + up @ OFFSETS[chest]
    points = [np.zeros_like(at)]
    hips = [hip for hip, _, _ in LEGS]
    points += [np.broadcast_to(OFFSETS[hip], at.shape) for hip in hips]
    points += [OFFSETS[hip] + pose[:, :, hip] @ OFFSETS[knee] for hip, knee, _ in LEGS]
    return (np.stack(points, 2) - at[:, :, None]) @ (up @ pose[:, :, chest])
