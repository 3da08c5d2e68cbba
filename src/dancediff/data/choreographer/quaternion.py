r"""Quaternions in numpy: small, batched, just what interpolating joints needs.

Symbols
    q  unit quaternion w, x, y, z   (..., 4)
    R  rotation matrix              (..., 3, 3)
"""

import numpy as np


def from_matrix(R: np.ndarray) -> np.ndarray:
    """Unit quaternions of rotation matrices, w >= 0; (..., 3, 3) -> (..., 4).

    >>> from_matrix(np.eye(3)).tolist()
    [1.0, 0.0, 0.0, 0.0]
    """
    from scipy.spatial.transform import Rotation

    q = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat()[:, [3, 0, 1, 2]]
    return (q * np.where(q[:, :1] < 0, -1.0, 1.0)).reshape(*R.shape[:-2], 4)


def to_matrix(q: np.ndarray) -> np.ndarray:
    r"""Rotation matrices of quaternions of any length; (..., 4) -> (..., 3, 3).

    >>> to_matrix(np.array([2.0, 0, 0, 0])).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    q = q / np.sqrt((q * q).sum(-1, keepdims=True))
    w, x, y, z = np.moveaxis(q, -1, 0)
    R = np.empty((*q.shape[:-1], 3, 3))
    R[..., 0, 0] = 1 - 2 * (y * y + z * z)
    R[..., 0, 1] = 2 * (x * y - w * z)
    R[..., 0, 2] = 2 * (x * z + w * y)
    R[..., 1, 0] = 2 * (x * y + w * z)
    R[..., 1, 1] = 1 - 2 * (x * x + z * z)
    R[..., 1, 2] = 2 * (y * z - w * x)
    R[..., 2, 0] = 2 * (x * z - w * y)
    R[..., 2, 1] = 2 * (y * z + w * x)
    R[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return R


def euler(pitch, bend, twist) -> np.ndarray:
    r"""Turn left by ``twist``, lean left by ``bend``, lean forward by ``pitch``: $R_y R_z R_x$.

    Shapes: three arrays (...), radians -> (..., 3, 3).

    >>> euler(0.0, 0.0, np.pi / 2).round(6)[0].tolist()                # front becomes left
    [0.0, 0.0, 1.0]
    """
    pitch, bend, twist = np.broadcast_arrays(pitch, -np.asarray(bend), twist)
    (cx, cz, cy), (sx, sz, sy) = ([f(a) for a in (pitch, bend, twist)] for f in (np.cos, np.sin))
    R = np.empty((*np.shape(cx), 3, 3))
    R[..., 0, 0] = cy * cz
    R[..., 0, 1] = sy * sx - cy * sz * cx
    R[..., 0, 2] = sy * cx + cy * sz * sx
    R[..., 1, 0] = sz
    R[..., 1, 1] = cz * cx
    R[..., 1, 2] = -cz * sx
    R[..., 2, 0] = -sy * cz
    R[..., 2, 1] = cy * sx + sy * sz * cx
    R[..., 2, 2] = cy * cx - sy * sz * sx
    return R
