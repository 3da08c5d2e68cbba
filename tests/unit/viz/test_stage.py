import os
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import roma
import torch

from dancediff.data.choreographer import choreograph
from dancediff.motion.contact import foot_contact
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import SMPL24
from dancediff.music.song import Music
from dancediff.viz import stage, stage_scene
from dancediff.viz.in_page import FOLDER
from dancediff.viz.mannequin import steady_quaternions
from dancediff.viz.palette import dancer_color
from places import ROOT

p3 = pytest.importorskip("pythreejs")
widgets = pytest.importorskip("ipywidgets")
_instances = pytest.importorskip("ipywidgets.widgets.widget")._instances
NODE_REQUIRED = "node" in os.environ.get("DANCEDIFF_REQUIRE", "")


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.2, 3, 0.5), dancers=2, seed=1, seconds=1.0)[0]


@pytest.fixture(scope="module")
def other():
    return choreograph(np.arange(0.2, 3, 0.5), dancers=3, seed=2, seconds=0.5)[0]


@pytest.fixture(autouse=True)
def _close():
    yield
    stage.close_all()


def inside(widget):
    """A widget and all that is in it."""
    found = [widget]
    for child in getattr(widget, "children", ()):
        found += inside(child)
    return found


def control(box, description):
    return next(w for w in inside(box) if getattr(w, "description", None) == description)


def on_stage(box, name):
    return next(child for child in box.children[0].scene.children if child.name == name)


def dancers_of(box):
    return [child for child in box.children[0].scene.children if child.name.startswith("dancer")]


def colors_of(dancer):
    return {part.material.color for part in inside(dancer) if isinstance(part, p3.Mesh)}


def tracks_of(*dances):
    return {track.name: track for track in stage_scene.make_clip(p3, list(dances)).tracks}


def places(group, origin, turn):
    """Positions of all joint groups of a dancer, by walking the scene as three.js would."""
    here = origin + turn @ np.array(group.position)
    found = {group.name: here}
    turn = turn @ roma.unitquat_to_rotmat(torch.tensor(group.quaternion)).double().numpy()
    for child in group.children:
        if "joint" in child.name:
            found |= places(child, here, turn)
    return found


def test_a_mesh_body_is_a_skin_on_moving_bones(dance):
    box = stage.play(dance, body="mesh")
    skins = [w for w in box.children[0].scene.children if isinstance(w, p3.SkinnedMesh)]
    assert [skin.material.color for skin in skins] == [dancer_color(0), dancer_color(1)]
    assert len({skin.geometry.model_id for skin in skins}) == 1  # sent once
    bones = skins[1].skeleton.bones
    assert [bone.name for bone in bones] == [f"dancer1joint{j}" for j in range(24)]
    assert set(places(bones[0], np.zeros(3), np.eye(3))) == {bone.name for bone in bones}
    weights = skins[0].geometry.attributes["skinWeight"].array
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-5)


@pytest.mark.parametrize("body", ["mannequin", "stick", "mesh"])
def test_stage_shows_the_first_frame(dance, body):
    joints = dance.joints()[:, 0].numpy()
    groups = dancers_of(stage.stage(dance, body=body))
    assert len(groups) == 2
    for k, group in enumerate(groups):
        found = places(group, np.zeros(3), np.eye(3))
        assert len(found) == 24
        for j in range(24):
            np.testing.assert_allclose(found[f"dancer{k}joint{j}"], joints[k, j], atol=1e-4)
        assert body == "mesh" or dancer_color(k) in colors_of(group)


def test_bones_of_sticks_end_in_joints(dance):
    knee = SMPL24.index("lknee")
    shin = stage_scene.make_shapes(p3, SMPL24, "stick")["lknee"].attributes["position"].array
    way = SMPL24.offsets[SMPL24.parents.index(knee)].numpy()
    along = shin @ way / np.linalg.norm(way)
    assert abs(along.max() - np.linalg.norm(way)) < 0.02 and abs(along.min()) < 0.02
    assert np.linalg.norm(shin - np.outer(along, way) / np.linalg.norm(way), axis=1).max() < 0.02


def test_unknown_bodies_are_refused(dance):
    with pytest.raises(ValueError, match="'robot' is unknown; choose from 'mannequin', 'stick'"):
        stage.stage(dance, body="robot")


def test_one_clip_moves_everybody(dance):
    tracks = tracks_of(dance)
    assert len(tracks) == 2 * (25 + 4 * 2) + 1
    np.testing.assert_allclose(tracks["dancer1joint0.position"].values, dance.root[1].numpy())
    turned = roma.unitquat_to_rotmat(torch.as_tensor(tracks["dancer1joint4.quaternion"].values))
    np.testing.assert_allclose(turned, dance.pose[1, :, 4], atol=1e-5)


def test_every_track_moves_something_that_is_there(dance, other):
    box = stage.stage(dance, beside=other)
    names = {part.name for part in inside(box.children[0].scene) if getattr(part, "name", "")}
    dances = stage_scene.side_by_side(dance, other)
    assert {name.split(".")[0] for name in tracks_of(*dances)} <= names


def test_quaternions_never_jump():
    angle = torch.linspace(0, 4 * torch.pi, 60)  # two full turns: the sign must come along
    pose = torch.eye(3).repeat(1, 60, 24, 1, 1)
    pose[0, :, 3] = axis_angle_to_matrix(angle[:, None] * torch.tensor([0.0, 1.0, 0.0]))
    q = steady_quaternions(Motion(pose, torch.zeros(1, 60, 3)))
    assert ((q[:, 1:] * q[:, :-1]).sum(-1) > 0.9).all()


def test_two_dances_stand_side_by_side_in_the_same_colors(dance, other):
    a, b = stage_scene.side_by_side(dance, other)
    assert b.root[..., 0].min() - a.root[..., 0].max() >= stage_scene.GAP - 1e-5
    torch.testing.assert_close(b.root[..., 1], other.root[..., 1])  # the same floor
    box = stage.stage(dance, beside=other)
    dancers = dancers_of(box)
    assert [d.name for d in dancers] == [f"dancer{number}joint0" for number in range(5)]
    assert colors_of(dancers[0]) == colors_of(dancers[2]) != colors_of(dancers[1])
    caption = box.children[-1].value
    assert "A</b> on the left: 2 dancers" in caption and "B</b> on the right: 3" in caption


def test_the_shorter_dance_stops_and_the_slider_covers_the_longer(dance, other):
    for a, b in ((dance, other), (other, dance)):
        box = stage.stage(a, beside=b)
        assert next(w for w in inside(box) if isinstance(w, widgets.IntSlider)).max == 29
        clip = stage_scene.make_clip(p3, [a, b])
        assert clip.duration == 29
        assert {track.times.max() for track in clip.tracks if "joint" in track.name} == {14, 29}


def test_dances_that_do_not_fit_are_refused(dance, other):
    with pytest.raises(ValueError, match="beside has fps=60, the dance 30"):
        stage.stage(dance, beside=replace(other, fps=60.0))
    names = ["hips", *SMPL24.names[1:]]
    with pytest.raises(ValueError, match="another skeleton"):
        stage.stage(dance, beside=replace(other, skeleton=replace(SMPL24, names=names)))


def test_dancers_are_numbered_as_swap_counts_them(dance):
    words = [w.material.map.string for d in dancers_of(stage.stage(dance)) for w in inside(d)
             if isinstance(w, p3.Sprite)]  # fmt: skip
    assert words == ["0", "1", "2"][: dance.num_dancers]


def test_trails_lie_where_the_dancers_go(dance):
    lines = on_stage(stage.stage(dance), "trails").children
    assert [line.material.color for line in lines] == [dancer_color(0), dancer_color(1)]
    path = lines[1].geometry.attributes["position"].array
    np.testing.assert_allclose(path[:, [0, 2]], dance.root[1][:, [0, 2]])
    assert 0 < path[:, 1].min() == path[:, 1].max() < 0.02


@pytest.mark.parametrize("own", [True, False])
def test_dots_are_seen_where_feet_stand(dance, own):
    stands = foot_contact(dance.joints())
    stands = 1 - stands if own else stands
    dance = replace(dance, contact=stands if own else None)
    tracks = tracks_of(dance)
    for k, c in ((0, 0), (1, 3)):
        size = tracks[f"dancer{k}foot{c}.scale"]
        assert size.interpolation == "InterpolateDiscrete"
        latest = np.searchsorted(size.times, np.arange(dance.num_frames), side="right") - 1
        np.testing.assert_array_equal(size.values[latest, 0] > 0.5, stands[k, :, c] > 0.5)
    at = tracks["dancer1foot3.position"].values
    np.testing.assert_allclose(at[:, [0, 2]], dance.joints()[1, :, 11][:, [0, 2]], atol=1e-6)


def test_marks_are_seen_at_first(dance):
    box = stage.stage(dance)
    assert on_stage(box, "trails").visible and control(box, "Trails").value
    assert on_stage(box, "dots").visible and control(box, "Feet on the floor").value


def test_controls_begin_at_rest(dance):
    box = stage.stage(dance)
    slider = next(w for w in inside(box) if isinstance(w, widgets.IntSlider))
    assert (slider.min, slider.max, slider.value) == (0, dance.num_frames - 1, 0)
    assert not control(box, "▶ Play").value
    assert control(box, "speed").value == "1" and control(box, "loop").value
    views = next(w for w in inside(box) if isinstance(w, widgets.ToggleButtons))
    assert views.value == "Orbit" and views.options == ("Orbit", "Top view", "Follow")
    assert not any(getattr(w, "description", "") == "sound" for w in inside(box))


def test_old_stages_are_closed_with_all_that_they_are_made_of(dance):
    """Three hundred widgets each, which kernel and page would keep."""
    short, before = dance.frames(0, 2), set(_instances)
    first = stage.stage(short)
    widgets_of_first = [_instances[name] for name in set(_instances) - before]
    assert len(widgets_of_first) > 100
    others = [stage.stage(short) for _ in range(stage._MAX_OPEN)]
    assert [w for w in widgets_of_first if w.comm is not None] == []
    assert first.children[0].comm is None
    assert all(w.comm is not None for box in others for w in inside(box))
    stage.close_all()
    assert not stage._open and set(_instances) == before


def test_the_renderer_is_closed_first(dance, monkeypatch):
    """The conductor in the page frees the sound when it is."""
    box, closed = stage.stage(dance.frames(0, 2)), []

    def close(widget):
        closed.append(widget)

    monkeypatch.setattr(widgets.Widget, "close", close)
    stage.close_all()
    assert closed[0] is box.children[0]


@pytest.mark.skipif(
    not NODE_REQUIRED and shutil.which("node") is None, reason="needs node: apt-get install nodejs"
)
def test_the_conductor_ends_what_it_began_and_is_not_late():
    """What it does in the page, with models of our own in the place of the notebook's."""
    command = ["node", str(ROOT / "tests" / "js" / "conduct.js"), str(FOLDER / "conductor.js")]
    said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout
    assert said and [line for line in said.splitlines() if not line.startswith("ok ")] == []


def test_one_frame_is_a_stage_too(dance):
    box = stage.stage(dance.frames(0, 1))
    assert next(w for w in inside(box) if isinstance(w, widgets.IntSlider)).max == 0


def test_with_a_song_it_can_be_muted(dance):
    song = Music(np.zeros((44100, 2), dtype=np.float32), 44100)
    assert control(stage.stage(dance, song), "sound").value


def test_play_is_stage():
    import dancediff

    assert dancediff.play is stage.stage


@pytest.mark.parametrize("name", ["pythreejs", "ipywidgets"])
def test_missing_package_names_the_extra(dance, monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError, match=r'pip install "dancediff\[notebooks\]"'):
        stage.stage(dance)
