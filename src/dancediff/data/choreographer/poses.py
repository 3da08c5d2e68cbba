r"""Arm poses, shared by all genres: directions of upper arm and forearm, and the bend of the wrist.

Directions are for the LEFT arm in the chest's frame: x outwards, y up, z to the front; the right
arm takes their mirror image. The elbow is a hinge: the plane of both directions sets how the upper
arm is rotated about itself, as in a real arm.

Symbols (axes: 4 joints = collar, shoulder, elbow, wrist)
    u, v  direction of upper arm and forearm       (3,)
    q     joint rotations as quaternions w, x, y, z (4, 4)
"""

from functools import cache

import numpy as np

from dancediff.data.choreographer.quaternion import from_matrix
from dancediff.motion.skeleton import SMPL24

# name: (upper arm, forearm, wrist flexion in degrees)
ARM_POSES = {
    # at rest and low
    "down": ((0.24, -1.0, -0.04), (0.12, -1.0, 0.32), 8),
    "low": ((0.42, -0.90, 0.02), (0.30, -0.84, 0.45), 8),
    "bent": ((0.27, -1.0, -0.18), (0.06, 0.10, 1.0), 0),
    "back": ((0.34, -0.88, -0.48), (0.26, -0.92, -0.08), 0),
    "pump": ((0.30, -0.84, -0.46), (0.02, -0.05, 1.0), 0),
    "drop": ((0.30, -0.92, 0.24), (0.10, -1.0, 0.42), 15),
    "hip": ((0.72, -0.68, -0.30), (-0.58, -0.66, 0.42), 10),
    "belt": ((0.62, -0.78, 0.05), (-0.50, -0.45, 0.70), 10),
    "cross-low": ((0.20, -0.80, 0.55), (-0.50, -0.62, 0.62), 0),
    "pocket": ((0.40, -0.90, -0.25), (0.12, -0.90, 0.45), 0),
    "lock": ((0.62, -0.64, 0.44), (-0.12, -0.74, 0.66), 25),
    "knee": ((0.35, -0.75, 0.55), (0.05, -0.90, 0.45), 0),
    # sides
    "out": ((1.0, -0.12, 0.12), (0.94, 0.0, 0.40), 0),
    "side-low": ((0.80, -0.58, 0.05), (0.80, -0.45, 0.36), 0),
    "second": ((0.96, -0.16, 0.24), (0.80, -0.22, 0.58), -10),
    "goal": ((1.0, -0.04, 0.10), (0.20, 1.0, 0.20), 0),
    "goal-down": ((1.0, 0.05, 0.05), (0.15, -1.0, 0.22), 0),
    "tut-up": ((1.0, 0.0, 0.06), (0.0, 1.0, 0.06), -60),
    "tut-in": ((1.0, -0.02, 0.12), (-0.82, 0.0, 0.58), 0),
    "tut-front": ((1.0, -0.02, 0.10), (0.05, -0.02, 1.0), 0),
    "wave-up": ((0.92, 0.36, 0.12), (0.88, -0.36, 0.32), 25),
    "wave-down": ((0.92, -0.36, 0.12), (0.86, 0.36, 0.30), -25),
    "lotus": ((0.92, 0.05, 0.34), (0.22, 0.90, 0.42), -45),
    "wing": ((0.90, -0.30, -0.32), (0.92, -0.05, -0.05), -15),
    # high
    "high": ((0.75, 0.60, 0.15), (0.52, 0.84, 0.28), 0),
    "up": ((0.38, 0.95, 0.10), (0.02, 1.0, 0.14), 0),
    "raise": ((0.85, 0.42, 0.20), (0.16, 1.0, 0.16), -20),
    "crown": ((0.62, 0.76, 0.16), (-0.52, 0.82, 0.22), 10),
    "temple": ((0.60, 0.80, 0.16), (-0.78, 0.66, 0.14), 0),
    "brow": ((0.85, 0.42, 0.32), (-0.62, 0.70, 0.36), 0),
    "nape": ((0.86, 0.48, 0.02), (-0.62, 0.50, -0.50), 0),
    "whip": ((0.74, 0.66, 0.12), (-0.12, -0.30, -0.92), 0),
    "fan": ((0.85, 0.30, 0.42), (0.50, 0.80, 0.35), -30),
    # front
    "front": ((0.28, -0.25, 0.95), (-0.04, 0.06, 1.0), 0),
    "reach": ((0.30, 0.18, 0.95), (0.10, 0.34, 0.95), 0),
    "first": ((0.50, -0.70, 0.50), (-0.48, -0.25, 0.82), 10),
    "fold": ((0.45, -0.60, 0.66), (-0.92, 0.12, 0.38), 0),
    "chest": ((0.95, -0.20, 0.24), (-0.78, 0.0, 0.62), 0),
    "heart": ((0.62, -0.62, 0.44), (-0.78, 0.32, 0.55), 10),
    "cross": ((0.32, -0.38, 0.86), (-0.82, 0.34, 0.34), 0),
    "pray": ((0.56, -0.72, 0.40), (-0.86, 0.36, 0.52), -20),
    "chin": ((0.62, -0.58, 0.52), (-0.50, 0.74, 0.48), 20),
    "frame": ((0.55, -0.76, 0.32), (-0.16, 0.20, 0.96), 0),
    "across": ((0.10, -0.14, 0.98), (-0.62, 0.04, 0.80), 0),
    "scoop": ((0.45, -0.60, 0.62), (0.15, 0.15, 1.0), -25),
    "face": ((0.72, 0.12, 0.64), (-0.58, 0.66, 0.50), -20),
}

_PARTS = {+1: (13, 16, 18, 20), -1: (14, 17, 19, 21)}  # collar, shoulder, elbow, wrist
_OFFSETS = SMPL24.offsets.numpy().astype(np.float64)


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
    _, _, elbow, wrist = _PARTS[side]
    rest_hinge = np.array([0.0, -side, 0.0])  # the axis about which a forearm folds to the front
    rise = 0.30 * u[1] + 0.04
    ahead = 0.22 * max(u[2] - 0.25 * side * u[0], 0.0)
    collar = _turn([0, 0, 1], side * rise) @ _turn([0, 1, 0], -side * ahead)
    upper = _frame(u, hinge) @ _frame(_OFFSETS[elbow], rest_hinge).T
    fore = _frame(v, hinge) @ _frame(_OFFSETS[wrist], rest_hinge).T
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
