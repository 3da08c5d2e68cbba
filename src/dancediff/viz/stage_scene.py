"""Everything that is on the stage, and the one clip that moves it.

Read first: `dancediff.viz.stage_dancers`.

Symbols (axes: n dancers · f frames)
    root    pelvis positions of all dancers, metres   (n, f, 3)
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from dancediff.axes import ON_FLOOR
from dancediff.motion.motion import Motion
from dancediff.viz.palette import FLOOR, GRID, MUTED, WALL
from dancediff.viz.stage_cameras import middle
from dancediff.viz.stage_dancers import make_dancer, make_label, make_shapes, make_tracks
from dancediff.viz.stage_marks import make_dot_tracks, make_dots, make_trails

GAP = 2.0  # metres between two dances on one floor


@dataclass
class Scene:
    """pythreejs' scene and clip, and those parts of the scene that a control reaches for."""

    scene: Any
    clip: Any
    trails: Any
    dots: Any
    middle: Any


def side_by_side(a: Motion, b: Motion) -> list[Motion]:
    """Both dances, the second moved to the right of the first.

    Raises: ValueError when they differ in frame rate or skeleton.
    """
    if a.fps != b.fps:
        raise ValueError(
            f"beside has fps={b.fps:g}, the dance {a.fps:g}; one slider moves both, so resample one"
        )
    if a.skeleton.names != b.skeleton.names:
        raise ValueError(
            "beside has another skeleton than the dance; see dancediff.data.retarget to make them "
            "the same"
        )
    right = float(a.root[..., 0].max() - b.root[..., 0].min()) + GAP
    depth = float(a.root[..., 2].mean() - b.root[..., 2].mean())
    return [a, replace(b, root=b.root + torch.tensor([right, 0.0, depth]))]


def roots(dances: list[Motion]) -> np.ndarray:
    """Roots in each frame of the longest dance, (n, f, 3); the last frame of a shorter one stays.

    >>> still = Motion(torch.eye(3).expand(1, 2, 24, 3, 3), torch.zeros(1, 2, 3))
    >>> roots([still, still.frames(0, 1)]).shape
    (2, 2, 3)
    """
    frames = max(dance.num_frames for dance in dances)
    pads = [((0, 0), (0, frames - dance.num_frames), (0, 0)) for dance in dances]
    each = [np.pad(d.root.numpy(), pad, mode="edge") for d, pad in zip(dances, pads, strict=True)]
    return np.concatenate(each)


def make_scene(p3, dances: list[Motion], body: str) -> Scene:
    """One or two dances with trails and dots on a floor, and the clip, which counts frames."""
    shapes, root = make_shapes(p3, dances[0].skeleton, body), roots(dances)
    dancers, trails, dots, number = [], [], [], 0
    for dance in dances:
        dots += make_dots(p3, dance, number)
        trails += make_trails(p3, dance)
        for k in range(dance.num_dancers):
            dancers += make_dancer(p3, dance, k, shapes, number + k)
        number += dance.num_dancers
    parts = Scene(
        scene=None,
        clip=make_clip(p3, dances),
        trails=p3.Group(name="trails", children=trails),
        dots=p3.Group(name="dots", children=dots),
        middle=p3.Object3D(name="middle"),
    )
    letters = _letters(p3, dances) if len(dances) > 1 else []
    marks = [parts.trails, parts.dots, parts.middle, *letters]
    parts.scene = p3.Scene(children=[*dancers, *marks, *_room(p3, root)], background=WALL)
    return parts


def make_clip(p3, dances: list[Motion]):
    """All dances in one clip; a dance that is over keeps its last pose."""
    tracks, first = [], 0
    for dance in dances:
        tracks += make_tracks(p3, dance, first) + make_dot_tracks(p3, dance, first)
        first += dance.num_dancers
    path = middle(roots(dances), dances[0].fps)
    times = np.arange(len(path), dtype=np.float32)
    tracks.append(p3.VectorKeyframeTrack(name="middle.position", times=times, values=path))
    return p3.AnimationClip(tracks=tracks, duration=float(max(len(path) - 1, 1)))


def _letters(p3, dances: list[Motion]) -> list:
    """A and B, on the floor at the outer sides of the two dances, where every view sees them."""
    letters = []
    for text, dance, side in zip("AB", dances, (-1, 1), strict=True):
        low, high = dance.root.numpy().min((0, 1)), dance.root.numpy().max((0, 1))
        outer = low[0] if side < 0 else high[0]
        letters.append(make_label(p3, text, (float(outer) + 0.35 * side, 0.2, float(high[2])), 0.4))
    return letters


def _room(p3, root: np.ndarray) -> list:
    low, high = root.min((0, 1)), root.max((0, 1))
    side = 2 * int(np.ceil((high - low)[ON_FLOOR].max() / 2 + 3))
    x, z = (round(float(at)) for at in ((low + high) / 2)[ON_FLOOR])
    floor = p3.Mesh(
        p3.PlaneBufferGeometry(side, side),
        p3.MeshStandardMaterial(color=FLOOR, roughness=1.0, metalness=0.0),
        position=(x, -0.004, z),
        quaternion=(-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)),
        receiveShadow=True,
    )
    grid = p3.GridHelper(side, side, colorCenterLine=MUTED, colorGrid=GRID, position=(x, 0.0, z))
    half = side / 2
    aim = p3.Object3D(position=(x, 0.0, z))
    sun = p3.DirectionalLight(
        color="#FFFFFF",
        intensity=0.55,
        position=(x + 2.5, 6.0, z + 3.5),
        castShadow=True,
        target=aim,
        shadow=p3.LightShadow(
            p3.OrthographicCamera(left=-half, right=half, top=half, bottom=-half, near=0.5, far=40),
            mapSize=(1024, 1024),
        ),
    )
    sky = p3.HemisphereLight(color="#FFFFFF", groundColor="#D9D4CC", intensity=0.62)
    return [floor, grid, aim, sun, sky]
