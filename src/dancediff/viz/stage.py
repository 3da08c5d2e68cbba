"""The 3-D stage of the notebooks: turn it, zoom it, play it; no kernel is needed while it plays.

Read first: `dancediff.viz.stage_scene`.

The scene is built and sent once. One clip moves all that moves in it, and a conductor in the page
sets the clip's time.
"""

from collections import deque
from functools import cache

from dancediff.motion.motion import Motion
from dancediff.music.song import as_song
from dancediff.viz.stage_cameras import FIELD, views
from dancediff.viz.stage_scene import make_scene, roots, side_by_side
from dancediff.viz.stage_timeline import conduct, make_controls
from dancediff.viz.still import dance_png, show_with_still

_MAX_OPEN = 6  # a page holds 8 to 16 WebGL pictures; beyond that the browser blanks the oldest
_open: deque = deque()  # of each stage the widgets that hold all others


def stage(
    motion: Motion,
    song=None,
    *,
    beside: Motion | None = None,
    body: str = "mannequin",
    size=(700, 396),
):
    """A dance to turn and to play, as a widget; ``dancediff.play`` is this function.

    Drag to turn, scroll to zoom. The song's sound is the clock, so dance and sound are in step at
    every speed. ``beside`` is a second dance, to the right on the same floor: one slider moves
    both, and the shorter one stops in its last frame. ``body`` is "mannequin", "stick" or "mesh", a
    human skin. ``song`` may be a path.

    Returns an ipywidgets.VBox. A page keeps the six newest stages; older ones are closed.
    Raises: ImportError naming the extra when pythreejs or ipywidgets is not installed; ValueError
    when the two dances differ in frame rate or skeleton, or for an unknown body.
    """
    p3, widgets = _import_widgets()
    song = as_song(song)
    dances = [motion] if beside is None else side_by_side(motion, beside)
    frames, fps = max(dance.num_frames for dance in dances), motion.fps
    aside = 0.22 if beside is None else 0.0  # from straight ahead neither looks larger
    eyes = views(roots(dances), fps, size[0] / size[1], aside)
    parts = make_scene(p3, dances, body)
    controls = make_controls(widgets, size[0], frames, fps, [eye["name"] for eye in eyes], song)
    links = [
        widgets.jslink((controls["trails"], "value"), (parts.trails, "visible")),
        widgets.jslink((controls["contacts"], "value"), (parts.dots, "visible")),
    ]
    renderer = _renderer(p3, parts.scene, eyes[0], size)
    mixer = p3.AnimationMixer(parts.scene)
    moved = {
        "renderer": renderer,
        "camera": renderer.camera,
        "orbit": renderer.controls[0],
        "scene": parts.scene,
        "middle": parts.middle,
        "mixer": mixer,
        "action": p3.AnimationAction(mixer, parts.clip, parts.scene),
    }
    script = conduct(p3, moved | controls, frames, fps, eyes)
    children = [renderer, *_rows(widgets, controls), *_caption(widgets, dances)]
    box = _box(widgets)(children, still=lambda: dance_png(dances[0], song))
    # the conductor listens to the renderer's end, so this one is closed first
    _remember([renderer, box, moved["action"], script, *controls.values(), *links])
    return box


play = stage


def close_all() -> None:
    """Close every stage that is open, and free their pictures in the browser."""
    while _open:
        _close(_open.popleft())


def _import_widgets():
    try:
        import ipywidgets
        import pythreejs
    except ImportError as err:
        raise ImportError(
            'the 3-D stage needs pythreejs and ipywidgets: pip install "dancediff[notebooks]"'
        ) from err
    return pythreejs, ipywidgets


@cache
def _box(widgets):
    """A VBox that leaves a filmstrip behind in a saved notebook."""

    class Stage(widgets.VBox):
        def __init__(self, children=(), still=bytes, **options):
            super().__init__(children, **options)
            self._png = still

        def _ipython_display_(self):
            show_with_still(self, self._png())

    return Stage


def _remember(parts: list) -> None:
    _open.append(parts)
    while len(_open) > _MAX_OPEN:
        _close(_open.popleft())


def _close(parts: list) -> None:
    """Close these widgets in their order, and then all that they are made of.

    A stage has hundreds; neither the kernel nor the page forgets one that is not closed.
    """
    found = {id(part): part for part in parts}
    waiting = list(parts)
    while waiting:
        part = waiting.pop()
        new = [one for key in part.keys for one in _widgets_in(getattr(part, key))]
        new = [one for one in new if id(one) not in found]
        found |= {id(one): one for one in new}
        waiting += new
    for part in found.values():
        part.close()


def _widgets_in(value) -> list:
    """The widgets that a widget's attribute is, or holds."""
    from ipywidgets import Widget

    if isinstance(value, dict):
        value = list(value.values())
    held = value if isinstance(value, list | tuple) else [value]
    return [one for one in held if isinstance(one, Widget)]


def _renderer(p3, scene, view: dict, size):
    camera = p3.PerspectiveCamera(
        fov=FIELD, aspect=size[0] / size[1], near=0.1, far=200, position=view["eye"]
    )
    orbit = p3.OrbitControls(controlling=camera, target=view["target"], maxPolarAngle=1.55)
    return p3.Renderer(
        scene=scene,
        camera=camera,
        controls=[orbit],
        width=size[0],
        height=size[1],
        antialias=True,
        shadowMap=p3.WebGLShadowMap(enabled=True, type="PCFSoftShadowMap"),
    )


def _rows(widgets, controls: dict) -> list:
    def row(*names):
        shown = [controls[name] for name in names if name in controls]
        return widgets.HBox(shown, layout={"align_items": "center", "grid_gap": "8px"})

    return [
        controls["ticks"],
        controls["slider"],
        row("play", "clock", "speed", "loop", "sound_on"),
        row("views", "trails", "contacts"),
    ]


def _caption(widgets, dances: list[Motion]) -> list:
    if len(dances) == 1:
        return []
    a, b = (f"{d.people}, {d.duration:.1f} s" for d in dances)
    return [widgets.HTML(f"<b>A</b> on the left: {a} · <b>B</b> on the right: {b}")]
