r"""From metres on the stage to points in a picture: a small camera of our own.

matplotlib's 3-D axes need 60 ms a frame; this needs next to nothing.

Symbols
    points   world positions, metres, y up            (..., 3)
    xy       picture coordinates, y up                (..., 2)    in units of ``size``
    scale    picture units a metre at that depth      (...)
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import gaussian_filter1d

_VIEW = 20.0  # degrees from the lower to the upper edge
_GLIDE = 1.5  # seconds over which the middle of the group is averaged
_NEAR = 0.1  # metres; nothing closer to the lens is drawn right


@dataclass(frozen=True)
class Camera:
    r"""A pinhole that looks from ``eye`` to ``target``, y upwards.

    $$xy = \text{centre} + s\,(r \cdot p,\; u \cdot p),\quad s = \frac{\text{focal}}{w \cdot p},
      \quad p = \text{point} - \text{eye}$$

    with the right, up and forward directions r, u, w of the camera.

    >>> front = Camera(eye=(0, 1, 5), target=(0, 1, 0), size=(200, 100), focal=100)
    >>> xy, scale = front.project(np.array([[0.0, 1, 0], [1, 1, 0]]))
    >>> xy.tolist(), scale.tolist()                 # a metre to the right is 20 units to the right
    ([[100.0, 50.0], [120.0, 50.0]], [20.0, 20.0])
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    size: tuple[float, float]
    focal: float

    @cached_property
    def axes(self) -> np.ndarray:
        """Right, up and forward as rows, (3, 3)."""
        forward = np.subtract(self.target, self.eye).astype(np.float64)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, (0.0, 1.0, 0.0))
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, forward), forward])

    def project(self, points) -> tuple[np.ndarray, np.ndarray]:
        """Picture coordinates (..., 2) and scale (...) of points (..., 3)."""
        local = (np.asarray(points, dtype=np.float64) - self.eye) @ self.axes.T
        scale = self.focal / np.maximum(local[..., 2], _NEAR)
        return local[..., :2] * scale[..., None] + np.divide(self.size, 2), scale


def follow(
    joints: np.ndarray,
    size: tuple[float, float],
    *,
    fps: float = 30.0,
    elevation: float = 13.0,
    margin: float = 0.9,
) -> list[Camera]:
    """One camera a frame that glides with the group and never loses a dancer.

    The camera looks from the audience's side, ``elevation`` degrees above the floor. It keeps its
    direction and its distance, which is just enough for every joint in every frame.

    Shapes: joints (n, f, j, 3) metres -> f cameras.

    >>> cameras = follow(np.zeros((2, 7, 24, 3)), (160, 90))
    >>> len(cameras), cameras[0].size
    (7, (160, 90))
    """
    low, high = joints.min((0, 2)), joints.max((0, 2))  # (f, 3)
    middle = (low + high) / 2
    middle[:, 1] = 0.9
    middle = gaussian_filter1d(middle, _GLIDE * fps, axis=0, mode="nearest")
    angle = np.radians(elevation)
    back = np.array([0.0, np.sin(angle), np.cos(angle)])
    axes = Camera(tuple(back), (0, 0, 0), size, 1.0).axes
    local = (joints - middle[None, :, None]) @ axes.T
    half = np.tan(np.radians(_VIEW) / 2) * margin
    need_y = np.abs(local[..., 1]) / half - local[..., 2]
    need_x = np.abs(local[..., 0]) / (half * size[0] / size[1]) - local[..., 2]
    distance = max(2.5, float(np.maximum(need_x, need_y).max()))
    focal = size[1] / 2 / np.tan(np.radians(_VIEW) / 2)
    return [Camera(tuple(m + distance * back), tuple(m), size, focal) for m in middle]
