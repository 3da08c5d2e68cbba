"""What lies on the stage's floor: trails where dancers go, dots under feet that stand.

Symbols (axes: n dancers · f frames)
    stands  a foot joint is on the floor   bool (n, f, 4)
"""

import numpy as np

from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import FOOT_JOINTS
from dancediff.viz.palette import INK, dancer_color

_DOT_HEIGHT, _TRAIL_HEIGHT = 0.004, 0.006  # metres: over the grid, under the feet


def make_trails(p3, motion: Motion) -> list:
    """A line on the floor a dancer, in its colour, where its root goes; nothing in it moves."""
    paths = motion.root.numpy().astype(np.float32)
    paths[..., 1] = _TRAIL_HEIGHT
    return [
        p3.Line(
            p3.BufferGeometry(attributes={"position": p3.BufferAttribute(path)}),
            p3.LineBasicMaterial(color=dancer_color(k)),
        )
        for k, path in enumerate(paths)
    ]


def make_dots(p3, motion: Motion, first: int = 0) -> list:
    """Discs for feet that stand, four a dancer; the tracks bring them to their places."""
    disc = p3.CircleBufferGeometry(0.09, 24)
    paint = p3.MeshBasicMaterial(color=INK, transparent=True, opacity=0.75)
    lying = (-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    names = [dot_name(first + k, c) for k in range(motion.num_dancers) for c in range(4)]
    return [p3.Mesh(disc, paint, name=name, quaternion=lying) for name in names]


def make_dot_tracks(p3, motion: Motion, first: int = 0) -> list:
    """Tracks that keep dots under their foot joints, and show them only while these stand."""
    stands = motion.contacts().numpy() > 0.5
    feet = motion.joints()[:, :, FOOT_JOINTS].numpy().astype(np.float32)
    feet[..., 1] = _DOT_HEIGHT
    return [
        track
        for k in range(motion.num_dancers)
        for c in range(len(FOOT_JOINTS))
        for track in _two_tracks(p3, dot_name(first + k, c), feet[k, :, c], stands[k, :, c])
    ]


def dot_name(number: int, c: int) -> str:
    """How clip and scene call the dot of a foot joint.

    >>> dot_name(1, 2)
    'dancer1foot2'
    """
    return f"dancer{number}foot{c}"


def changes(stands: np.ndarray) -> np.ndarray:
    """Frames in which a foot comes down or lifts, the first frame too.

    >>> changes(np.array([True, True, False, True])).tolist()
    [0, 2, 3]
    """
    return np.flatnonzero(np.r_[True, stands[1:] != stands[:-1]])


def _two_tracks(p3, name: str, places: np.ndarray, stands: np.ndarray) -> list:
    times, at = np.arange(len(places), dtype=np.float32), changes(stands)
    # not quite 0: a mesh of no size has no normals, and three.js says so in every frame
    size = np.where(stands[at], 1.0, 1e-3).astype(np.float32)
    return [
        p3.VectorKeyframeTrack(name=f"{name}.position", times=times, values=places),
        p3.VectorKeyframeTrack(
            name=f"{name}.scale",
            times=at.astype(np.float32),
            values=np.repeat(size[:, None], 3, axis=1),
            interpolation="InterpolateDiscrete",
        ),
    ]
