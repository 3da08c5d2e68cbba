"""A script for Blender: a dance, its song, a camera and a light, at the right rate.

Read first: docs/export.md.

    blender --python blender.py -- dance.glb [song.wav] [scene.blend]

It is run by Blender (4.2 or newer), whose Python has no dancediff, so nothing of it is imported
here. What the startup file shows goes away; a scene that was opened before stays as it is.
With a third file the scene is saved there, with ``blender -b`` and no window.
"""

import json
import math
import struct
import sys
from itertools import product
from pathlib import Path

SAMPLES = 24  # frames at which the dancers are looked for
MARGIN = 0.4  # metres around their joints
CAMERA_TURN = (math.radians(80), 0.0, 0.0)  # from the audience, a little from above
SUN_TURN = (math.radians(40), math.radians(15), 0.0)


def glb_facts(path: Path) -> dict:
    """The frame rate and the number of frames of a .glb that dancediff wrote.

    Raises: SystemExit naming a file that is another one.
    """
    content = path.read_bytes()
    try:
        magic, _, _, length = struct.unpack_from("<4s3I", content)
        book = json.loads(content[20 : 20 + length])
        fps = float(book["asset"]["extras"]["fps"])
        clock = book["animations"][0]["samplers"][0]["input"]
        frames = int(book["accessors"][clock]["count"])
    except (struct.error, ValueError, LookupError, TypeError) as err:
        raise SystemExit(f"{path} is no .glb written by dancediff ({err})") from err
    if magic != b"glTF":
        raise SystemExit(f"{path} is no .glb written by dancediff (it does not begin with glTF)")
    return {"fps": fps, "frames": frames}


def load_dance(bpy, dance: Path, song: Path | None = None) -> None:
    """Build the scene. ``bpy`` is Blender's own module."""
    scene, facts = bpy.context.scene, glb_facts(dance)
    if not bpy.data.filepath:  # the startup file: its cube, camera and light
        for thing in list(scene.objects):
            bpy.data.objects.remove(thing, do_unlink=True)
    # first, since the importer turns seconds into frames at the scene's rate
    scene.render.fps, scene.render.fps_base = round(facts["fps"]), 1.0
    before, actions = set(scene.objects), set(bpy.data.actions)
    bpy.ops.import_scene.gltf(filepath=str(dance))
    dancers = [thing for thing in scene.objects if thing not in before]
    new = [action for action in bpy.data.actions if action not in actions]
    first = round(min(action.frame_range[0] for action in new))
    seconds = (facts["frames"] - 1) / facts["fps"]
    scene.frame_start, scene.frame_end = first, first + round(seconds * scene.render.fps)
    if song is not None:
        editor = scene.sequence_editor or scene.sequence_editor_create()
        strips = editor.strips if hasattr(editor, "strips") else editor.sequences  # before 4.4
        strips.new_sound(name=song.stem, filepath=str(song), channel=1, frame_start=first)
        scene.sync_mode = "AUDIO_SYNC"  # frames are dropped, so that sound and dance stay together
    low, high = _box(scene, dancers)
    _look_at(bpy, scene, low, high)
    scene.frame_set(first)


def _box(scene, dancers) -> tuple[list[float], list[float]]:
    """The corners of what the joints reach in the whole dance."""
    points = []
    step = max((scene.frame_end - scene.frame_start) // SAMPLES, 1)
    for frame in range(scene.frame_start, scene.frame_end + 1, step):
        scene.frame_set(frame)
        for thing in dancers:
            if thing.type == "ARMATURE":
                points += [thing.matrix_world @ bone.head for bone in thing.pose.bones]
            elif not (thing.parent and thing.parent.type == "ARMATURE"):  # a skin does not move
                points.append(thing.matrix_world.translation.copy())
    low = [min(p[axis] for p in points) - MARGIN for axis in range(3)]
    high = [max(p[axis] for p in points) + MARGIN for axis in range(3)]
    return low, high


def _look_at(bpy, scene, low, high) -> None:
    """A camera that sees the box, and a sun."""
    camera = bpy.data.objects.new("Dance camera", bpy.data.cameras.new("Dance camera"))
    sun = bpy.data.objects.new("Dance sun", bpy.data.lights.new("Dance sun", "SUN"))
    sun.data.energy = 3.0
    camera.rotation_euler, sun.rotation_euler = CAMERA_TURN, SUN_TURN
    sun.location = (low[0], low[1], high[2] + 2)
    for thing in (camera, sun):
        scene.collection.objects.link(thing)
    scene.camera = camera
    bpy.context.view_layer.update()
    corners = product(*zip(low, high, strict=True))
    numbers = [number for corner in corners for number in corner]
    place, _ = camera.camera_fit_coords(bpy.context.evaluated_depsgraph_get(), numbers)
    camera.location = place


def main() -> None:
    """Read the names of files behind ``--``, build the scene, save it if a .blend is named."""
    behind = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    given = [Path(name).absolute() for name in behind]
    scenes = [path for path in given if path.suffix == ".blend"]
    files = [path for path in given if path.suffix != ".blend"]
    try:
        import bpy
    except ImportError as err:
        raise SystemExit(f"run it in Blender: blender --python {__file__} -- dance.glb") from err
    if not 1 <= len(files) <= 2 or len(scenes) > 1:
        raise SystemExit(f"{len(given)} files are given; give dance.glb [song.wav] [scene.blend]")
    for path in files:
        if not path.is_file():
            raise SystemExit(f"{path} does not exist")
    load_dance(bpy, *files)
    for path in scenes:
        bpy.ops.wm.save_as_mainfile(filepath=str(path))


if __name__ == "__main__":
    main()
