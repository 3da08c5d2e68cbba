"""The script for Blender, with a Blender that writes down what it is told.

DANCEDIFF_BLENDER=PYTHON, a Python that has Blender's own module (pip install bpy), runs it in one.
"""

import math
import os
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest
import soundfile

from dancediff.data.choreographer import choreograph
from dancediff.export import blender
from dancediff.motion.motion import Motion


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("blender")
    dance = choreograph([0.5, 1.0], dancers=2, seed=0, seconds=2.0)[0]
    dance.save(folder / "dance.glb")
    dance.save(folder / "skins.glb", body="mesh")
    soundfile.write(folder / "song.wav", np.zeros((64000, 2), np.float32), 32000)
    return folder


class Point(list):
    """A place that can be copied, as Blender's are."""

    def copy(self):
        return Point(self)


class Thing(SimpleNamespace):
    """Something of which there is one."""

    __hash__ = object.__hash__


class Things(list):
    """A collection of Blender's: makes things, links them and takes them away."""

    def new(self, name, *more):
        return Thing(name=name, more=more, data=more[0] if more else None, type="NEW")

    link = list.append

    def remove(self, thing, do_unlink=True):
        list.remove(self, thing)


class Blender:
    """As much of bpy as the script uses. Its dancers are the joints of the file's dance."""

    def __init__(self, opened="", strips="strips"):
        self.objects, self.at, self.told = Things(), 0, []
        self.objects += [Thing(name="Cube"), Thing(name="Light")]
        sounds = SimpleNamespace(**{strips: SimpleNamespace(new_sound=self.new_sound)})
        self.scene = SimpleNamespace(
            objects=self.objects,
            collection=SimpleNamespace(objects=self.objects),
            render=SimpleNamespace(fps=24, fps_base=1.0),
            sequence_editor=None,
            sequence_editor_create=lambda: sounds,
            sync_mode="NONE",
            frame_set=self.frame_set,
        )
        self.context = SimpleNamespace(
            scene=self.scene,
            view_layer=SimpleNamespace(update=lambda: None),
            evaluated_depsgraph_get=lambda: "graph",
        )
        self.data = SimpleNamespace(
            filepath=opened,
            objects=self,
            cameras=Things(),
            lights=Things(),
            actions=[Thing(frame_range=(-9.0, 9.0))] if opened else [],
        )
        self.ops = SimpleNamespace(import_scene=SimpleNamespace(gltf=self.gltf))

    def new(self, name, data):
        made = Things().new(name, data)
        made.camera_fit_coords = lambda graph, numbers: (self.told.append(numbers), (1, 2, 3))[::-1]
        return made

    def remove(self, thing, do_unlink):
        self.objects.remove(thing)

    def frame_set(self, frame):
        self.at = frame

    def new_sound(self, **how):
        self.told.append(how)

    def gltf(self, filepath):
        self.told.append(self.scene.render.fps)
        joints = Motion.load(filepath).joints().numpy()
        self.data.actions.append(Thing(frame_range=(0.0, joints.shape[1] - 1.0)))
        for track in joints.transpose(0, 2, 1, 3).reshape(-1, joints.shape[1], 3):
            self.objects.append(Joint(self, track))


class Joint:
    """A node of a dancer: x to the right, y away from the audience, z up."""

    type, parent = "EMPTY", None

    def __init__(self, world, track):
        self.world, self.track = world, track

    @property
    def matrix_world(self):
        x, y, z = self.track[self.world.at].tolist()
        return SimpleNamespace(translation=Point([x, -z, y]))


@pytest.mark.parametrize("strips", ["strips", "sequences"])
def test_dance_song_camera_and_rate(files, strips):
    world = Blender(strips=strips)
    blender.load_dance(world, files / "dance.glb", files / "song.wav")
    scene = world.scene
    rate, sound, box = world.told
    assert rate == scene.render.fps == 30  # known before the importer places keys
    assert (scene.frame_start, scene.frame_end, world.at) == (0, 59, 0)
    assert sound["filepath"] == str(files / "song.wav") and sound["frame_start"] == 0
    assert scene.sync_mode == "AUDIO_SYNC"
    names = [getattr(thing, "name", None) for thing in world.objects]
    assert not {"Cube", "Light"} & {*names} and "Dance sun" in names
    assert scene.camera.name == "Dance camera" and scene.camera.location == (1, 2, 3)
    assert math.degrees(scene.camera.rotation_euler[0]) == pytest.approx(80)
    joints = Motion.load(files / "dance.glb").joints().numpy().reshape(-1, 3)
    low, high = np.reshape(box, (8, 3)).min(0), np.reshape(box, (8, 3)).max(0)
    reach = joints[:, [0, 2, 1]] * [1, -1, 1]
    assert (low < reach.min(0)).all() and (high > reach.max(0)).all()
    assert (high - low < np.ptp(reach, axis=0) + 1).all()


def test_an_opened_scene_is_kept_and_a_dance_may_be_silent(files):
    world = Blender(opened="mine.blend")
    blender.load_dance(world, files / "dance.glb")
    assert {"Cube", "Light"} <= {getattr(thing, "name", None) for thing in world.objects}
    assert (world.scene.sync_mode, world.scene.frame_start) == ("NONE", 0)


@pytest.mark.parametrize("name", ["dance.glb", "skins.glb"])
def test_rate_and_length_are_read_from_the_file(files, name):
    assert blender.glb_facts(files / name) == {"fps": 30.0, "frames": 60}


@pytest.mark.parametrize("content", [b"", b"glTF", b"RIFF" + bytes(40)])
def test_another_file_is_refused_by_name(content, tmp_path):
    (tmp_path / "other.glb").write_bytes(content)
    with pytest.raises(SystemExit, match=r"other\.glb is no \.glb written by dancediff"):
        blender.glb_facts(tmp_path / "other.glb")


def test_without_blender_it_says_how_to_run_it(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "bpy", None)
    with pytest.raises(SystemExit, match=r"blender --python .*blender\.py -- dance\.glb"):
        blender.main()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dance.glb", "skins.glb"])
def test_in_blender(files, name, tmp_path):
    python = os.environ.get("DANCEDIFF_BLENDER")
    if not python:
        pytest.skip("needs Blender: set DANCEDIFF_BLENDER to a Python with bpy")
    saved = tmp_path / "scene.blend"
    run = [python, blender.__file__, "--", files / name, files / "song.wav", saved]
    subprocess.run(run, check=True, capture_output=True)
    look = tmp_path / "look.py"
    look.write_text(LOOK)
    done = subprocess.run([python, look, saved], check=True, capture_output=True, text=True)
    start, end, fps, sound, *reach = done.stdout.splitlines()[-1].split()
    assert (start, end, fps, sound) == ("0", "59", "30", "60")
    assert all(0 < float(share) < 1 for share in reach)  # of the picture's width and height


LOOK = """
import sys
import bpy
from bpy_extras.object_utils import world_to_camera_view

bpy.ops.wm.open_mainfile(filepath=sys.argv[-1])
scene, seen = bpy.context.scene, []
for frame in range(scene.frame_start, scene.frame_end + 1, 7):
    scene.frame_set(frame)
    for o in scene.objects:
        if o.type == "ARMATURE":
            seen += [world_to_camera_view(scene, scene.camera, o.matrix_world @ b.head)
                     for b in o.pose.bones]
        elif o.name.startswith("dancer") and not o.name.endswith("body"):
            seen.append(world_to_camera_view(scene, scene.camera, o.matrix_world.translation))
editor = scene.sequence_editor
strips = editor.strips if hasattr(editor, "strips") else editor.sequences
reach = [f(p[k] for p in seen) for f in (min, max) for k in (0, 1)]
print(scene.frame_start, scene.frame_end, scene.render.fps, strips[0].frame_final_end, *reach)
"""
