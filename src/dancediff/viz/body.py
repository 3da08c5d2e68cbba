r"""A dancer's body as flat shapes: capsules around bones, filled limb by limb.

Read first: `dancediff.viz.projection`.

A limb is the union of a few capsules, written as ONE path (matplotlib fills with the non-zero
rule, so overlapping capsules of the same winding melt together). Three dancers are some thirty
paths, which is what makes video fast.

Symbols (axes: n dancers · f frames)
    points   24 joints and a few points of head and feet, metres     (n, f, 30, 3)
    shape    (outline (v, 2), colour)                                to be filled in this order
"""

import numpy as np

from dancediff.axes import ON_FLOOR
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import world_rotations
from dancediff.viz.palette import BEAT, GRID, INK, PAPER, dancer_color, mix, rgb
from dancediff.viz.projection import Camera

# Points that SMPL has no joint for: (name, parent joint, offset in the joint's frame, metres).
_EXTRA = (
    ("skull", 15, (0.0, 0.075, 0.015)),
    ("face", 15, (0.0, 0.060, 0.062)),
    ("lheel", 7, (0.0, -0.045, -0.045)),
    ("rheel", 8, (0.0, -0.045, -0.045)),
    ("ltip", 10, (0.0, 0.0, 0.06)),
    ("rtip", 11, (0.0, 0.0, 0.06)),
)
SKULL, FACE, LHEEL, RHEEL, LTIP, RTIP = range(24, 30)
HEAD_RADIUS = 0.105
_REACH = 6  # metres of floor on each side of the camera's target
_SHADES = 6  # steps in which the floor grid fades
_FADES = 8  # steps in which a trail fades
_TRAIL = 0.045  # metres, width
_RING = np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 24, endpoint=False)), 0 * a, np.sin(a)], -1)
_SHADOW = mix(INK, "#334466", 0.5)

# limb -> capsules (point a, point b, radius at a, radius at b), metres
_LEFT_LEG = (
    (1, 4, 0.085, 0.058),
    (4, 7, 0.056, 0.036),
    (LHEEL, 10, 0.034, 0.034),
    (7, LHEEL, 0.036, 0.034),
    (7, 10, 0.036, 0.030),
    (10, LTIP, 0.032, 0.024),
)
_LEFT_ARM = ((16, 18, 0.052, 0.040), (18, 20, 0.039, 0.028), (20, 22, 0.030, 0.034))


def _right(limb):
    """The same on the right: each of its points comes just after the left one."""
    return tuple((a + 1, b + 1, *radii) for a, b, *radii in limb)


LIMBS = {
    "lleg": _LEFT_LEG,
    "rleg": _right(_LEFT_LEG),
    "torso": (
        (1, 2, 0.082, 0.082),
        (0, 3, 0.118, 0.116),
        (3, 6, 0.116, 0.125),
        (6, 9, 0.125, 0.120),
        (9, 12, 0.105, 0.052),
        (13, 14, 0.060, 0.060),
        (13, 16, 0.062, 0.050),
        (14, 17, 0.062, 0.050),
        (6, 16, 0.095, 0.050),
        (6, 17, 0.095, 0.050),
        (12, 15, 0.048, 0.048),
    ),
    "larm": _LEFT_ARM,
    "rarm": _right(_LEFT_ARM),
    "head": ((SKULL, SKULL, HEAD_RADIUS, HEAD_RADIUS),),
    "face": ((FACE, FACE, 0.074, 0.074),),
}
_HALF = 9  # corners of each half circle
_CAPSULES = np.array([c for limb in LIMBS.values() for c in limb])
_A, _B = _CAPSULES[:, 0].astype(int), _CAPSULES[:, 1].astype(int)
_RADII = np.repeat(_CAPSULES[:, 2:][:, ::-1], _HALF, axis=1)  # (k, 2 * 9): around b, then around a
_LIMB_OF = np.repeat(np.arange(len(LIMBS)), [len(limb) for limb in LIMBS.values()])
_TURN = np.linspace(-np.pi / 2, np.pi / 2, _HALF)
_TURN = np.concatenate([_TURN, _TURN + np.pi])
# What lies in front when two limbs are equally deep; near or far by 1 % outweighs all of it.
_BIAS = dict(zip(LIMBS, (0, 0, -0.002, 0.004, 0.004, 0.004, 0.003), strict=True))
# Arms and legs grow out of the torso: their rims begin this far along the first capsule.
_TRIM = np.zeros(len(_CAPSULES))
_TRIM[[0, 6]], _TRIM[[23, 26]] = 0.45, 0.35


def body_points(motion: Motion) -> np.ndarray:
    """Joints, skull, nose, heels and toe tips, (n, f, 30, 3) metres.

    >>> import torch
    >>> body_points(Motion(torch.eye(3).expand(1, 2, 24, 3, 3), torch.zeros(1, 2, 3))).shape
    (1, 2, 30, 3)
    """
    joints = motion.joints().numpy()
    Q = world_rotations(motion.pose, motion.skeleton).numpy()
    extra = [joints[:, :, j] + Q[:, :, j] @ np.array(offset, np.float32) for _, j, offset in _EXTRA]
    return np.concatenate([joints, np.stack(extra, 2)], axis=2)


def capsules(xy: np.ndarray, scale: np.ndarray, grow: float = 0.0, trim=0.0) -> np.ndarray:
    """Outlines of all capsules of all dancers, all winding the same way.

    ``trim`` moves the first end of each capsule that share of its length, (k,) or a number.

    Shapes: xy (n, 30, 2), scale (n, 30) -> (n, k, 18, 2); ``grow`` metres are added to each radius.

    >>> capsules(np.zeros((3, 30, 2)), np.ones((3, 30))).shape
    (3, 31, 18, 2)
    """
    a, b = xy[:, _A], xy[:, _B]
    a = a + np.reshape(trim, (-1, 1)) * (b - a)
    angle = np.arctan2(*np.moveaxis((b - a)[..., ::-1], -1, 0))[..., None] + _TURN
    centre = np.repeat(np.stack([b, a], 2), _HALF, axis=2)
    pixels = np.repeat(np.stack([scale[:, _B], scale[:, _A]], 2), _HALF, axis=2)
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    radii = _RADII.copy()
    radii[:, _HALF:] += np.reshape(trim, (-1, 1)) * (radii[:, :_HALF] - radii[:, _HALF:])
    return centre + ((radii + grow) * pixels)[..., None] * ring


def dancer_shapes(points: np.ndarray, camera: Camera, *, halo: float = 0.012, dancer=None):
    """Filled outlines of all dancers in one frame, from back to front.

    Every dancer is a white silhouette with a dark rim, then limb by limb; far limbs are darker, and
    a light face tells front from back. ``dancer``: all of them are poses of this one.

    Shapes: points (n, 30, 3) -> list of (outlines (k, v, 2), RGBA).
    """
    xy, scale = camera.project(points)  # (n, p, 2), (n, p)
    white, rim, fill = (capsules(xy, scale, halo * g) for g in (1.7, 0.5, 0.0))
    cut = capsules(xy, scale, halo * 0.5, _TRIM)
    core = scale.mean(1)
    at = (scale[:, _A] + scale[:, _B]) / 2 / core[:, None]
    near = np.stack([at[:, _LIMB_OF == m].mean(1) for m in range(len(LIMBS))], 1)  # (n, limbs)
    names = list(LIMBS)
    shapes = []
    for i in np.argsort(core):  # far dancers first
        color = dancer_color(i if dancer is None else dancer)
        dark = (*mix(color, INK, 0.55), 1.0)
        shapes += [(white[i], (*rgb(PAPER), 0.9)), (rim[i], dark)]
        for m in np.argsort(near[i] + list(_BIAS.values())):
            tone = mix(color, INK, min(max(-4 * (near[i, m] - 0.997), 0), 0.3))
            tone = mix(color, PAPER, 0.55) if names[m] == "face" else tone
            limb = _LIMB_OF == m
            if names[m] not in ("torso", "face"):
                shapes.append((cut[i, limb], dark))
            shapes.append((fill[i, limb], (*tone, 1.0)))
    return shapes


def shadow_shapes(points: np.ndarray, camera: Camera):
    """Soft shadows of bodies and feet on the floor; a lifted foot's shadow is fainter.

    Shapes: points (n, 30, 3) -> list of (outlines (1, v, 2), RGBA).
    """
    body = points[:, [0, 9, 7, 8]].mean(1, keepdims=True)  # (n, 1, 3)
    feet = 0.35 * points[:, [7, 8]] + 0.65 * points[:, [10, 11]]  # (n, 2, 3)
    lift = np.clip(points[:, [10, 11], 1] - 0.02, 0, None)
    shapes = []  # where bodies' shadows meet, the floor gets no darker
    for radius in np.linspace(0.46, 0.16, 7):
        shapes.append((_discs(body, radius, camera), (*_SHADOW, 0.03)))
    for radius in (0.12, 0.10, 0.08):
        alpha = (0.11 / (1 + 12 * lift)).ravel()
        discs = zip(_discs(feet, radius, camera)[:, None], alpha, strict=True)
        shapes += [(disc, (*_SHADOW, float(v))) for disc, v in discs]
    return shapes


def _discs(centres, radius: float, camera: Camera) -> np.ndarray:
    """Discs on the floor below points (..., 3), as seen: (k, 24, 2)."""
    return camera.project(centres[..., None, :] * (1, 0, 1) + radius * _RING)[0].reshape(
        -1, len(_RING), 2
    )


def floor_ribbon(a, b, width, camera: Camera) -> np.ndarray:
    """Quads on the floor along lines from a to b (..., 3), ``width`` metres wide, (k, 4, 2)."""
    along = (b - a)[..., ON_FLOOR]
    along = along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    side = np.stack([-along[..., 1], np.zeros(along.shape[:-1]), along[..., 0]], -1) * width / 2
    return camera.project(np.stack([a - side, b - side, b + side, a + side], -2))[0].reshape(
        -1, 4, 2
    )


def grid_shapes(camera: Camera, pulse: float = 0.0, *, width: float = 0.012):
    """The metre grid around the camera's target, fading outwards; a beat tints it for a moment.

    >>> len(grid_shapes(Camera((0, 2, 6), (0, 1, 0), (160, 90), 100)))
    6
    """
    cx, _, cz = camera.target
    x = np.floor(cx) + np.arange(-_REACH, _REACH + 1)
    z = np.floor(cz) + np.arange(-_REACH, 4)
    at = np.stack(np.broadcast_arrays(x, 0.0, z[:, None]), -1)
    a = np.concatenate([at[:, :-1].reshape(-1, 3), at[:-1].reshape(-1, 3)])
    b = np.concatenate([at[:, 1:].reshape(-1, 3), at[1:].reshape(-1, 3)])
    away = np.linalg.norm(((a + b) / 2 - (cx, 0, cz))[:, ON_FLOOR], axis=1)
    alpha = np.clip(1 - away / _REACH, 0, 1)
    quads = floor_ribbon(a, b, width * (1 + 0.6 * pulse), camera)
    tint = mix(GRID, BEAT, 0.4 * pulse)
    level = np.minimum((alpha * _SHADES).astype(int), _SHADES - 1)
    return [
        (quads[(level == v) & (alpha > 0.02)], (*tint, (v + 0.5) / _SHADES * 0.95))
        for v in range(_SHADES)
    ]


def trail_shapes(path: np.ndarray, camera: Camera, color: str):
    """Where a root has just been, (k, 3) metres, as a ribbon on the floor that fades backwards."""
    if len(path) < 2:
        return []
    quads = floor_ribbon(path[:-1] * (1, 0, 1), path[1:] * (1, 0, 1), _TRAIL, camera)
    level = np.arange(len(quads)) * _FADES // len(quads)  # one shape a level: they are costly
    tone = rgb(color)
    return [(quads[level == v], (*tone, 0.6 * (v + 0.5) / _FADES)) for v in np.unique(level)]


def label_spots(points: np.ndarray) -> np.ndarray:
    """Where a dancer's number lies on the floor, in front of the feet; (..., 30, 3) -> (..., 3)."""
    return points[..., [0, 7, 8], :].mean(-2) * (1, 0, 1) + (0, 0, 0.52)


def to_paths(shapes):
    """Shapes as matplotlib paths and their face colours."""
    from matplotlib.path import Path

    paths, colors = [], []
    for outlines, color in shapes:
        k, v, _ = outlines.shape
        if k == 0:
            continue
        codes = np.full((k, v + 1), Path.LINETO, dtype=Path.code_type)
        codes[:, 0], codes[:, -1] = Path.MOVETO, Path.CLOSEPOLY
        closed = np.concatenate([outlines, outlines[:, :1]], axis=1)
        paths.append(Path(closed.reshape(-1, 2), codes.ravel()))
        colors.append(color)
    return paths, np.array(colors)
