"""The 3-D stage of the notebooks: turn it, zoom it, play it; no kernel is needed while it plays.

The scene is built once. Every joint is a group inside its parent's group, and one clip with one
quaternion track a joint and one position track a dancer moves them all. The clip stands still by
itself (time scale 0); a slider in the browser sets its time.
"""

import io
from collections import deque

import numpy as np

from dancediff.motion.motion import Motion
from dancediff.viz.mannequin import (
    EGGS,
    FACE,
    SKULL,
    TUBES,
    lighter,
    steady_quaternions,
    turn_up_to,
)
from dancediff.viz.palette import FLOOR, GRID, MUTED, WALL, dancer_color

_MAX_OPEN = 6  # a page holds 8 to 16 WebGL pictures; beyond that the browser blanks the oldest
_open: deque = deque()


def stage(motion: Motion, song=None, *, size=(760, 430)):
    """A dance to turn and to play, as a widget; ``dancediff.play`` is this function.

    Drag to turn, scroll to zoom. With a song there is a sound player below; it has a start button
    of its own, so dance and sound are in step only as well as you press both. For exact sound use
    ``motion.save("dance.mp4", song)``.

    Returns an ipywidgets.VBox. A page keeps the six newest stages; older ones are closed.
    Raises: ImportError naming the extra when pythreejs or ipywidgets is not installed.
    """
    p3, widgets = _import_widgets()
    skin = _Skin(p3, motion)
    dancers = [skin.dancer(k) for k in range(motion.num_dancers)]
    scene = p3.Scene(children=[*dancers, *_room(p3, motion)], background=WALL)
    action = p3.AnimationAction(p3.AnimationMixer(scene), make_clip(p3, motion), scene)
    action.timeScale = 0.0  # only the slider moves its time
    renderer = _renderer(p3, scene, motion, size)
    last = motion.num_frames - 1
    play = widgets.Play(min=0, max=last, interval=round(1000 / motion.fps), repeat=True)
    slider = widgets.IntSlider(
        min=0, max=last, description="frame", layout={"width": f"{size[0] - 190}px"}
    )
    widgets.jslink((play, "value"), (slider, "value"))
    widgets.jslink((slider, "value"), (action, "time"))
    action.play()
    rows = [renderer, widgets.HBox([play, slider])]
    if song is not None:
        rows.append(_player(widgets, song, motion.duration))
    box = widgets.VBox(rows)
    _remember(renderer)
    return box


play = stage


def close_all() -> None:
    """Close every stage that is open, and free their pictures in the browser."""
    while _open:
        _open.popleft().close()


def _import_widgets():
    try:
        import ipywidgets
        import pythreejs
    except ImportError as err:
        raise ImportError(
            'the 3-D stage needs pythreejs and ipywidgets: pip install "dancediff[notebooks]"'
        ) from err
    return pythreejs, ipywidgets


def _remember(renderer) -> None:
    _open.append(renderer)
    while len(_open) > _MAX_OPEN:
        _open.popleft().close()


class _Skin:
    """Builds dancers; they share geometry, each has a colour."""

    def __init__(self, p3, motion: Motion):
        self.p3, self.motion, self.skeleton = p3, motion, motion.skeleton
        self.offsets = motion.skeleton.offsets.numpy().astype(float)
        self.start = steady_quaternions(motion.frames(0, 1))[:, 0]
        self.ball = p3.SphereBufferGeometry(1.0, 20, 14)
        self.tubes = {r: p3.CylinderBufferGeometry(r[1], r[0], 1.0, 16, 1, True) for r in _radii()}

    def dancer(self, k: int):
        p3, parents = self.p3, self.skeleton.parents
        color = dancer_color(k)
        skin = p3.MeshStandardMaterial(color=color, roughness=0.75, metalness=0.0)
        face = p3.MeshStandardMaterial(color=lighter(color), roughness=0.8, metalness=0.0)
        parts: list[list] = [[] for _ in parents]
        for joint, centre, axes in EGGS:
            parts[self.skeleton.index(joint)].append(self._egg(centre, axes, skin))
        for joint, *tube in TUBES:
            parts[self.skeleton.index(joint)] += self._capsule(*tube, skin)
        head = parts[self.skeleton.index("head")]
        head += [self._egg(SKULL, [0.105] * 3, skin), self._egg(FACE, [0.072] * 3, face)]
        groups: list = [None] * len(parents)
        for j in reversed(range(len(parents))):  # children come after their parents
            kids = [groups[c] for c, parent in enumerate(parents) if parent == j]
            place = self.motion.root[k, 0].tolist() if j == 0 else self.offsets[j].tolist()
            turn = self.start[k, j].tolist()
            groups[j] = p3.Group(
                name=_name(k, j), position=place, quaternion=turn, children=parts[j] + kids
            )
        return groups[0]

    def _point(self, at) -> np.ndarray:
        return self.offsets[self.skeleton.index(at)] if isinstance(at, str) else np.array(at, float)

    def _egg(self, centre, axes, material):
        place = tuple(map(float, centre))
        return self.p3.Mesh(self.ball, material, position=place, scale=tuple(axes), castShadow=True)

    def _capsule(self, a, b, radius_a, radius_b, material) -> list:
        a, b = self._point(a), self._point(b)
        tube = self.p3.Mesh(
            self.tubes[radius_a, radius_b],
            material,
            position=tuple(map(float, (a + b) / 2)),
            quaternion=turn_up_to(b - a),
            scale=(1.0, float(np.linalg.norm(b - a)), 1.0),
            castShadow=True,
        )
        return [
            tube,
            self._egg(a, [radius_a] * 3, material),
            self._egg(b, [radius_b] * 3, material),
        ]


def _radii() -> set[tuple[float, float]]:
    return {(part[3], part[4]) for part in TUBES}


def _name(k: int, j: int) -> str:
    return f"dancer{k}joint{j}"


def make_clip(p3, motion: Motion):
    """All dancers in one clip whose clock counts frames: 24 quaternion tracks and a path each."""
    times = np.arange(motion.num_frames, dtype=np.float32)
    quaternions = steady_quaternions(motion)
    tracks = []
    for k in range(motion.num_dancers):
        root = motion.root[k].numpy().astype(np.float32)
        tracks.append(
            p3.VectorKeyframeTrack(name=f"{_name(k, 0)}.position", times=times, values=root)
        )
        tracks += [
            p3.QuaternionKeyframeTrack(
                name=f"{_name(k, j)}.quaternion", times=times, values=quaternions[k, :, j].copy()
            )
            for j in range(motion.skeleton.num_joints)
        ]
    return p3.AnimationClip(tracks=tracks, duration=float(max(motion.num_frames - 1, 1)))


def _room(p3, motion: Motion) -> list:
    root = motion.root.numpy()
    middle = (root.min((0, 1)) + root.max((0, 1))) / 2
    side = 2 * int(np.ceil(np.ptp(root[..., [0, 2]], axis=(0, 1)).max() / 2 + 3))
    place = (round(float(middle[0])), 0.0, round(float(middle[2])))
    floor = p3.Mesh(
        p3.PlaneBufferGeometry(side, side),
        p3.MeshStandardMaterial(color=FLOOR, roughness=1.0, metalness=0.0),
        position=(place[0], -0.004, place[2]),
        receiveShadow=True,
    )
    floor.rotateX(-np.pi / 2)
    grid = p3.GridHelper(side, side, colorCenterLine=MUTED, colorGrid=GRID, position=place)
    sun = p3.DirectionalLight(
        color="#FFFFFF",
        intensity=0.55,
        position=(place[0] + 2.5, 6.0, place[2] + 3.5),
        castShadow=True,
    )
    sky = p3.HemisphereLight(color="#FFFFFF", groundColor="#D9D4CC", intensity=0.62)
    return [floor, grid, sun, sky]


def _renderer(p3, scene, motion: Motion, size):
    root = motion.root.numpy()
    target = (root.min((0, 1)) + root.max((0, 1))) / 2
    target[1] = 0.9
    reach = float(np.linalg.norm(np.ptp(root[..., [0, 2]], axis=(0, 1)))) / 2 + 1.0
    eye = target + np.array([0.25, 0.32, 1.0]) * (reach * 1.25 + 2.2)
    camera = p3.PerspectiveCamera(
        fov=32, aspect=size[0] / size[1], near=0.1, far=80, position=eye.tolist()
    )
    orbit = p3.OrbitControls(controlling=camera, target=target.tolist(), maxPolarAngle=1.55)
    camera.lookAt(target.tolist())
    return p3.Renderer(
        scene=scene,
        camera=camera,
        controls=[orbit],
        width=size[0],
        height=size[1],
        antialias=True,
        shadowMap=p3.WebGLShadowMap(enabled=True, type="PCFSoftShadowMap"),
    )


def _player(widgets, song, seconds: float):
    import soundfile

    part = song.slice(0, min(seconds, song.duration))
    sound = io.BytesIO()
    soundfile.write(sound, part.audio[:, :2], part.rate, format="MP3")
    return widgets.Audio(value=sound.getvalue(), format="mp3", autoplay=False, loop=True)
