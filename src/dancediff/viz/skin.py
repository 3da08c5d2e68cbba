r"""A human body whose skin follows the joints: the mesh that stage and .glb files can show.

Read first: `dancediff.motion.skeleton`.

Symbols (axes: v points · t triangles · j joints)
    points     skin in the rest pose, pelvis at the origin, metres    (v, 3)
    normals    which way the skin looks there                         (v, 3)
    triangles  numbers of three points                                (t, 3)
    joints     the four joints that a point follows                   (v, 4)
    weights    how much it follows each, sum 1                        (v, 4)
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import torch

from dancediff.motion.skeleton import SMPL24, forward_kinematics

FILE = Path(__file__).parents[1] / "assets" / "body" / "body.npz"


@dataclass(frozen=True, eq=False)
class Skin:
    """A body in the rest pose, see the symbols above."""

    points: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    joints: np.ndarray
    weights: np.ndarray


@cache
def body_skin() -> Skin:
    """The packaged body (CC0, see assets/body); float32 and uint16.

    >>> skin = body_skin()
    >>> skin.triangles.shape[1], bool((abs(skin.weights.sum(1) - 1) < 1e-5).all())
    (3, True)
    """
    with np.load(FILE, allow_pickle=False) as book:
        points, triangles = book["points"], book["triangles"]
        joints, weights = book["joints"].astype(np.uint16), book["weights"]
    return Skin(points, _normals(points, triangles), triangles, joints, weights)


def rest_joints() -> np.ndarray:
    """Where joints are in the rest pose, pelvis at the origin, (j, 3)."""
    still = torch.eye(3).expand(SMPL24.num_joints, 3, 3)
    return forward_kinematics(still, torch.zeros(3)).numpy()


def _normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The mean of the triangles around a point, large ones counting more."""
    a, b, c = (points[corner] for corner in triangles.T)
    faces = np.cross(b - a, c - a)
    normals = np.zeros_like(points)
    for corner in triangles.T:
        np.add.at(normals, corner, faces)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
