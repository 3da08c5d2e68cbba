"""Triangles of a dancer's body, each part in the frame of its joint, for files that need them.

Symbols (axes: v vertices · t triangles)
    points     where a vertex is, metres, in its joint's frame   (v, 3)
    normals    which way the surface looks there                 (v, 3)
    triangles  numbers of three vertices                         (t, 3)
"""

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from dancediff.motion.skeleton import SMPL24
from dancediff.viz.mannequin import EGGS, FACE, SKULL, TUBES, turn_up_to

AROUND, UP = 16, 10  # corners of a circle, rings of a ball
Solid = tuple[np.ndarray, np.ndarray, np.ndarray]  # points, normals, triangles


@cache
def body_solids() -> dict[str, Solid]:
    """The body of every joint that has one, float32 and uint16.

    >>> solids = body_solids()
    >>> solids["lknee"][0].shape[1], "face" in solids
    (3, True)
    """
    offsets = dict(zip(SMPL24.names, SMPL24.offsets.double().numpy(), strict=True))
    parts: dict[str, list[Solid]] = {}
    for joint, centre, axes in EGGS:
        parts.setdefault(joint, []).append(egg(centre, axes))
    for joint, *ends, radius_a, radius_b in TUBES:
        a, b = (offsets[end] if isinstance(end, str) else np.array(end, float) for end in ends)
        parts.setdefault(joint, []).extend(capsule(a, b, radius_a, radius_b))
    parts.setdefault("head", []).append(egg(SKULL, [0.105] * 3))
    parts["face"] = [egg(FACE, [0.072] * 3)]  # of another colour, so a part of its own
    return {joint: joined(solids) for joint, solids in parts.items()}


def egg(centre, axes) -> Solid:
    """An ellipsoid.

    >>> points, normals, triangles = egg((0, 1, 0), (0.1, 0.2, 0.3))
    >>> points.max(0).round(2).tolist()
    [0.1, 1.2, 0.3]
    """
    theta, phi = np.linspace(0, np.pi, UP + 1), np.linspace(0, 2 * np.pi, AROUND + 1)
    theta, phi = (g.ravel() for g in np.meshgrid(theta, phi, indexing="ij"))
    ball = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1)
    axes = np.asarray(axes, float)
    normals = ball / axes
    return ball * axes + centre, _unit(normals), _without_points(_grid(UP))


def capsule(a, b, radius_a: float, radius_b: float) -> list[Solid]:
    """A tube from a to b that widens from one radius to the other, and a ball at each end."""
    length = np.linalg.norm(b - a)
    phi = np.linspace(0, 2 * np.pi, AROUND + 1)
    circle = np.stack([np.cos(phi), np.zeros_like(phi), np.sin(phi)], -1)
    up = np.array([0.0, 1.0, 0.0])
    points = np.concatenate([circle * radius_b + length * up, circle * radius_a])
    normals = np.tile(_unit(circle * length + up * (radius_a - radius_b)), (2, 1))
    turn = Rotation.from_quat(turn_up_to(b - a))
    tube = turn.apply(points) + a, turn.apply(normals), _grid(1)
    return [tube, egg(a, [radius_a] * 3), egg(b, [radius_b] * 3)]


def joined(solids: list[Solid]) -> Solid:
    """Several solids as one.

    >>> ball = egg((0, 0, 0), (1, 1, 1))
    >>> [len(a) == 2 * len(b) for a, b in zip(joined([ball, ball]), ball, strict=True)]
    [True, True, True]
    """
    starts = np.cumsum([0, *(len(points) for points, _, _ in solids)])
    triangles = [corners + start for (_, _, corners), start in zip(solids, starts, strict=False)]
    return (
        np.concatenate([points for points, _, _ in solids]).astype(np.float32),
        np.concatenate([normals for _, normals, _ in solids]).astype(np.float32),
        np.concatenate(triangles).astype(np.uint16),
    )


def _grid(rings: int) -> np.ndarray:
    """Triangles between ``rings`` + 1 circles, each of AROUND + 1 points, seen from outside."""
    i, k = (g.ravel() for g in np.meshgrid(range(rings), range(AROUND), indexing="ij"))
    here, below = i * (AROUND + 1) + k, (i + 1) * (AROUND + 1) + k
    one = np.stack([here, here + 1, below], -1)
    other = np.stack([here + 1, below + 1, below], -1)
    return np.concatenate([one, other])


def _without_points(triangles: np.ndarray) -> np.ndarray:
    """Leave out triangles at the poles, where two of their corners are one place."""
    north, south = triangles < AROUND + 1, triangles >= UP * (AROUND + 1)
    return triangles[(north.sum(1) < 2) & (south.sum(1) < 2)]


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
