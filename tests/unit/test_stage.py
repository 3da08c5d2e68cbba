import sys

import numpy as np
import pytest
import roma
import torch

from dancediff.data.choreographer import choreograph
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.music.song import Music
from dancediff.viz import stage
from dancediff.viz.mannequin import steady_quaternions

p3 = pytest.importorskip("pythreejs")
widgets = pytest.importorskip("ipywidgets")


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.2, 3, 0.5), dancers=2, seed=1, seconds=1.0)[0]


@pytest.fixture(autouse=True)
def _close():
    yield
    stage.close_all()


def dancers_of(box):
    scene = box.children[0].scene
    return [child for child in scene.children if child.name.startswith("dancer")]


def places(group, origin, turn):
    """Positions of all joint groups of a dancer, by walking the scene as three.js would."""
    here = origin + turn @ np.array(group.position)
    found = {group.name: here}
    turn = turn @ roma.unitquat_to_rotmat(torch.tensor(group.quaternion)).double().numpy()
    for child in group.children:
        if isinstance(child, p3.Group):
            found |= places(child, here, turn)
    return found


def test_stage_shows_the_first_frame(dance):
    box = stage.stage(dance)
    joints = dance.joints()[:, 0].numpy()
    groups = dancers_of(box)
    assert len(groups) == 2
    for k, group in enumerate(groups):
        found = places(group, np.zeros(3), np.eye(3))
        assert len(found) == 24
        for j in range(24):
            np.testing.assert_allclose(found[f"dancer{k}joint{j}"], joints[k, j], atol=1e-4)


def test_one_clip_moves_everybody(dance):
    clip = stage.make_clip(p3, dance)
    names = [track.name for track in clip.tracks]
    assert len(names) == len(set(names)) == 2 * 25
    lengths = {len(track.times) for track in clip.tracks}
    assert lengths == {dance.num_frames}
    track = clip.tracks[names.index("dancer1joint0.position")]
    np.testing.assert_allclose(track.values, dance.root[1].numpy())
    track = clip.tracks[names.index("dancer1joint4.quaternion")]
    turned = roma.unitquat_to_rotmat(torch.as_tensor(track.values))
    np.testing.assert_allclose(turned, dance.pose[1, :, 4], atol=1e-5)


def test_quaternions_never_jump():
    angle = torch.linspace(0, 4 * torch.pi, 60)  # two full turns: the sign must come along
    pose = torch.eye(3).repeat(1, 60, 24, 1, 1)
    pose[0, :, 3] = axis_angle_to_matrix(angle[:, None] * torch.tensor([0.0, 1.0, 0.0]))
    q = steady_quaternions(Motion(pose, torch.zeros(1, 60, 3)))
    assert ((q[:, 1:] * q[:, :-1]).sum(-1) > 0.9).all()


def test_slider_covers_the_dance_and_starts_paused(dance):
    box = stage.stage(dance)
    play, slider = box.children[1].children
    assert (slider.min, slider.max, slider.value) == (0, dance.num_frames - 1, 0)
    assert (play.max, play.interval) == (dance.num_frames - 1, 33)
    assert not play.playing


def test_sound_is_cut_to_the_dance(dance):
    song = Music(np.zeros((44100 * 4, 2), dtype=np.float32), 44100)
    quiet, loud = stage.stage(dance), stage.stage(dance, song)
    assert len(quiet.children) == 2
    audio = loud.children[2]
    assert isinstance(audio, widgets.Audio)
    assert not audio.autoplay
    assert 1000 < len(audio.value) < 40_000  # a second of mp3, not four


def test_old_stages_are_closed(dance):
    short = dance.frames(0, 2)
    renderers = [stage.stage(short).children[0] for _ in range(stage._MAX_OPEN + 1)]
    assert renderers[0].comm is None
    assert all(renderer in stage._open for renderer in renderers[1:])
    stage.close_all()
    assert not stage._open


def test_one_frame_is_a_stage_too(dance):
    assert stage.stage(dance.frames(0, 1)).children[1].children[1].max == 0


def test_play_is_stage():
    import dancediff

    assert dancediff.play is stage.stage


@pytest.mark.parametrize("name", ["pythreejs", "ipywidgets"])
def test_missing_package_names_the_extra(dance, monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError, match=r'pip install "dancediff\[notebooks\]"'):
        stage.stage(dance)
