"""The jointed body of a dancer: rigid parts, each fixed to a joint, and how joints turn in time.

The stage in the notebooks and exported files show the same body.
"""

import numpy as np
import roma

from dancediff.motion.motion import Motion

# (frame of joint, centre, half axes), metres: the trunk is four eggs that melt into each other
EGGS = (
    ("root", (0, -0.035, -0.005), (0.155, 0.125, 0.108)),
    ("belly", (0, 0.01, 0.005), (0.128, 0.150, 0.098)),
    ("spine", (0, 0.06, -0.005), (0.135, 0.160, 0.105)),
    ("chest", (0, 0.06, -0.015), (0.158, 0.130, 0.105)),
)
# (frame of joint, from, to, radius at from, radius at to); a joint's name or an offset in metres
TUBES = (
    ("chest", (0, 0.12, -0.02), "neck", 0.070, 0.052),
    ("neck", (0, 0, 0), "head", 0.050, 0.050),
    *[(f"{s}collar", (0, 0, 0), f"{s}shoulder", 0.060, 0.055) for s in "lr"],
    *[(f"{s}shoulder", (0, 0, 0), f"{s}elbow", 0.052, 0.042) for s in "lr"],
    *[(f"{s}elbow", (0, 0, 0), f"{s}wrist", 0.040, 0.029) for s in "lr"],
    *[(f"{s}wrist", (0, 0, 0), f"{s}hand", 0.031, 0.034) for s in "lr"],
    *[(f"{s}hip", (0, 0, 0), f"{s}knee", 0.086, 0.060) for s in "lr"],
    *[(f"{s}knee", (0, 0, 0), f"{s}ankle", 0.057, 0.037) for s in "lr"],
    *[(f"{s}ankle", (0, 0, 0), (0, -0.045, -0.04), 0.038, 0.036) for s in "lr"],
    *[(f"{s}ankle", (0, -0.045, -0.04), f"{s}toe", 0.036, 0.032) for s in "lr"],
    *[(f"{s}toe", (0, 0, 0), (0, 0, 0.06), 0.032, 0.024) for s in "lr"],
)
SKULL, FACE = (0.0, 0.075, 0.015), (0.0, 0.060, 0.062)


def steady_quaternions(motion: Motion) -> np.ndarray:
    """Joint rotations as quaternions (x, y, z, w) that never flip sign from frame to frame.

    Shapes: motion -> float32 (n, f, j, 4).

    >>> import torch
    >>> still = Motion(torch.eye(3).expand(1, 2, 24, 3, 3), torch.zeros(1, 2, 3))
    >>> steady_quaternions(still)[0, 0, 0].tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    q = roma.rotmat_to_unitquat(motion.pose).numpy()
    same = np.sign((q[:, 1:] * q[:, :-1]).sum(-1, keepdims=True))
    q[:, 1:] *= np.cumprod(np.where(same == 0, 1, same), axis=1)
    return q.astype(np.float32)


def turn_up_to(direction: np.ndarray) -> tuple[float, float, float, float]:
    """Quaternion (x, y, z, w) that turns the y axis, on which tubes are built, to a direction.

    >>> [round(q, 3) for q in turn_up_to(np.array([-2.0, 0.0, 0.0]))]
    [0.0, 0.0, 0.707, 0.707]
    """
    x, y, z = direction / np.linalg.norm(direction)
    if y < -0.999999:
        return 1.0, 0.0, 0.0, 0.0
    q = np.array([z, 0.0, -x, 1 + y])
    return tuple((q / np.linalg.norm(q)).tolist())


def lighter(color: str) -> str:
    """Half way to white, as the face is.

    >>> lighter("#0072B2")
    '#7FB8D8'
    """
    return "#" + "".join(f"{(int(color[i : i + 2], 16) + 255) // 2:02X}" for i in (1, 3, 5))
