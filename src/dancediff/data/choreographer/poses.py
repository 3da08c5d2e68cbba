r"""Arm poses, shared by all genres: directions of upper arm and forearm, and the bend of the wrist.

They are listed in ``poses.toml``. Directions are for the LEFT arm in the chest's frame: x outwards,
y up, z to the front; the right arm takes their mirror image. The elbow is a hinge: the plane of
both directions sets how the upper arm is rotated about itself, as in a real arm.

Symbols (axes: 4 joints = collar, shoulder, elbow, wrist)
    u, v  direction of upper arm and forearm       (3,)
    q     joint rotations as quaternions w, x, y, z (4, 4)
"""

import tomllib
from functools import cache
from pathlib import Path

import numpy as np

from dancediff.data.choreographer.footsteps import OFFSETS
from dancediff.data.choreographer.quaternion import from_matrix

ARM_POSES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
ARM_JOINTS = ((13, 16, 18, 20), (14, 17, 19, 21))  # left, right: collar, shoulder, elbow, wrist


def unit(x) -> np.ndarray:
    """Scale vectors to length 1."""
    x = np.asarray(x, dtype=np.float64)
    return x / np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-9)


def _frame(bone, axis) -> np.ndarray:
    a = unit(bone)
    b = unit(axis - (axis @ a) * a)
    return np.stack([a, b, np.cross(a, b)], -1)


def _turn(axis, angle: float) -> np.ndarray:
    x, y, z = unit(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def arm_quaternions(u, v, hinge, flexion: float, side: int) -> np.ndarray:
    r"""Collar, shoulder, elbow and wrist rotations that point an arm.

    The collar rises and comes forward with the upper arm, as a shoulder blade does.

    Shapes: u, v, hinge (3,) in the chest's frame; side +1 left, -1 right -> (4, 4) quaternions.

    >>> arm_quaternions([1, 0, 0.0], [1, 0, 0.1], [0, -1.0, 0], 0, 1).shape
    (4, 4)
    """
    _, _, elbow, wrist = ARM_JOINTS[side < 0]
    rest_hinge = np.array([0.0, -side, 0.0])  # the axis about which a forearm folds to the front
    rise = 0.30 * u[1] + 0.04
    ahead = 0.22 * max(u[2] - 0.25 * side * u[0], 0.0)
    collar = _turn([0, 0, 1], side * rise) @ _turn([0, 1, 0], -side * ahead)
    upper = _frame(u, hinge) @ _frame(OFFSETS[elbow], rest_hinge).T
    fore = _frame(v, hinge) @ _frame(OFFSETS[wrist], rest_hinge).T
    hand = _turn(rest_hinge, np.radians(flexion))
    return from_matrix(np.stack([collar, collar.T @ upper, upper.T @ fore, hand]))


@cache
def pose_key(name: str, side: int) -> np.ndarray:
    """Joint rotations of a named pose, (4, 4) quaternions."""
    u, v, n, flexion = _directions(name, side)
    return arm_quaternions(u, v, n, flexion, side)


@cache
def pose_between(first: str, second: str, side: int) -> np.ndarray:
    """The arm half way between two poses: wide changes bow outwards and to the front, (4, 4)."""
    (u0, v0, n0, w0), (u1, v1, n1, w1) = _directions(first, side), _directions(second, side)
    bow = np.array([0.75 * side, 0.05, 0.55])
    u = unit(u0 + u1 + bow * max(0.0, 0.75 - u0 @ u1))
    v = unit(v0 + v1 + bow * max(0.0, 0.55 - v0 @ v1))
    hinge = np.cross(u, v)
    if np.linalg.norm(hinge) < 0.25:  # nearly straight: keep the plane of the poses
        hinge = hinge + 0.5 * unit(n0 + n1)
    return arm_quaternions(u, v, unit(hinge), (w0 + w1) / 2, side)


@cache
def _directions(name: str, side: int):
    upper, fore, flexion = ARM_POSES[name]
    flip = np.array([side, 1.0, 1.0])
    u, v = unit(np.array(upper) * flip), unit(np.array(fore) * flip)
    return u, v, unit(np.cross(u, v)), flexion
