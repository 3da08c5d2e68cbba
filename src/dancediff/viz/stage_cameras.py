"""From where the stage is seen: the eye of each view, and the path that "Follow" walks.

Symbols (axes: n dancers · f frames)
    root    pelvis positions of all dancers, metres   (n, f, 3)
    middle  where the group is, on the floor                     (f, 3)
"""

import numpy as np

FIELD = 32.0  # degrees, from the lower to the upper edge
_HALF_HEIGHT, _ARM = 1.1, 0.6  # metres: of a dancer with the number above it; beside its root
_SLOW = 1.0  # seconds over which the followed middle is averaged: the floor glides, it never shakes


def views(root: np.ndarray, fps: float, aspect: float, aside: float = 0.22) -> list[dict]:
    """What the buttons show: eye and target, and whether the mouse turns it or the group leads it.

    The eye of "Follow" counts from the middle of the group. ``aside`` is how far the eye stands to
    the right, for each metre to the front.

    >>> [view["name"] for view in views(np.zeros((2, 3, 3)), 30.0, 16 / 9)]
    ['Orbit', 'Top view', 'Follow']
    """
    low, high = root.min((0, 1)), root.max((0, 1))
    there = (low + high) / 2 * [1, 0, 1] + [0, _HALF_HEIGHT, 0]
    here = np.array([0.0, _HALF_HEIGHT, 0.0])
    reach = np.abs(root - middle(root, fps)).max((0, 1))
    slant, above = np.array([aside, 0.3, 1.0]), np.array([0.0, 1.0, 1e-4])
    return [
        _view("Orbit", there + _way_back((high - low) / 2, slant, aspect), there),
        _view("Top view", there + _way_back((high - low) / 2, above, aspect), there, turns=False),
        _view("Follow", here + _way_back(reach, slant, aspect), here, follows=True),
    ]


def middle(root: np.ndarray, fps: float) -> np.ndarray:
    """The middle of the group on the floor, averaged over a second; float32.

    Shapes: root (n, f, 3) -> (f, 3).

    >>> middle(np.ones((2, 3, 3)), 30.0)[0].tolist()
    [1.0, 0.0, 1.0]
    """
    path = root.mean(0) * [1.0, 0.0, 1.0]
    window = np.hanning(2 * max(round(_SLOW * fps / 2), 1) + 1)
    side = len(window) // 2
    path = np.pad(path, ((side, side), (0, 0)), mode="edge")
    smooth = [np.convolve(axis, window / window.sum(), mode="valid") for axis in path.T]
    return np.stack(smooth, -1).astype(np.float32)


def _view(name: str, eye, target, *, turns: bool = True, follows: bool = False) -> dict:
    return {
        "name": name,
        "eye": np.round(eye, 4).tolist(),
        "target": np.round(target, 4).tolist(),
        "turns": turns,
        "follows": follows,
    }


def _way_back(half: np.ndarray, slant: np.ndarray, aspect: float) -> np.ndarray:
    """From the target to the nearest eye in a direction that sees every corner of a box."""
    ahead = slant / np.linalg.norm(slant)
    side = np.cross([0.0, 1.0, 0.0], ahead)
    side /= np.linalg.norm(side)
    reach = np.tan(np.radians(FIELD / 2))
    signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3)
    corners = signs * (half * [1, 0, 1] + [_ARM, _HALF_HEIGHT, _ARM])
    upwards = np.abs(corners @ np.cross(ahead, side)) / reach
    sideways = np.abs(corners @ side) / (reach * aspect)
    return ahead * (corners @ ahead + np.maximum(upwards, sideways)).max()
