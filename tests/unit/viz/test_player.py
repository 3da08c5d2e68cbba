"""What the HTML player's page holds; what it does is tested in a browser (tests/browser)."""

import base64
import io
import json
import re

import numpy as np
import pytest
import soundfile
import torch

from dancediff.data.choreographer import choreograph
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import Skeleton
from dancediff.music.song import Music
from dancediff.viz.mannequin import steady_quaternions
from dancediff.viz.player import save_player
from dancediff.viz.style import MP3_RATES, mp3


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.2, 20, 0.5), dancers=3, seed=1, seconds=20)[0]


@pytest.fixture(scope="module")
def song():
    t = np.arange(20 * 44100) / 44100
    hum = 0.3 * np.sin(2 * np.pi * 220 * t) * (t % 0.5 < 0.1)
    return Music(np.stack([hum, hum], -1).astype(np.float32), 44100, name="</script><b>hum")


def data_of(path):
    text = path.read_text(encoding="utf-8")
    return text, json.loads(re.search(r'id="data">(.*?)</script>', text, re.DOTALL).group(1))


def test_three_dancers_twenty_seconds_with_music_are_small(dance, song, tmp_path):
    path = save_player(dance, tmp_path / "a.html", song)
    assert path.stat().st_size < 2_000_000


def test_page_holds_the_motion(dance, song, tmp_path):
    _, data = data_of(save_player(dance, tmp_path / "a.html", song, metrics=False))
    (pane,) = data["panes"]
    turns = np.frombuffer(base64.b64decode(pane["turns"]), "<i2").reshape(
        3, dance.num_frames, 24, 4
    )
    np.testing.assert_allclose(turns / 32767, steady_quaternions(dance), atol=2e-5)
    root = np.frombuffer(base64.b64decode(pane["root"]), "<f4").reshape(3, -1, 3)
    np.testing.assert_array_equal(root, dance.root.numpy())
    assert (data["frames"], data["fps"]) == (dance.num_frames, 30)
    feet = np.frombuffer(base64.b64decode(pane["contact"]), np.uint8).reshape(3, -1)
    np.testing.assert_array_equal((feet >> 2) & 1, dance.contact[..., 2].numpy() > 0.5)


def test_quaternions_lose_next_to_nothing():
    R = axis_angle_to_matrix(torch.randn(1, 50, 24, 3, generator=torch.Generator().manual_seed(0)))
    q = steady_quaternions(Motion(R, torch.zeros(1, 50, 3))).astype(float)
    kept = np.round(q * 32767) / 32767
    kept /= np.linalg.norm(kept, axis=-1, keepdims=True)
    cosine = np.abs((kept * q / np.linalg.norm(q, axis=-1, keepdims=True)).sum(-1)).clip(max=1)
    assert np.degrees(2 * np.arccos(cosine)).max() < 0.02


def test_a_name_cannot_become_code(dance, song, tmp_path):
    text, data = data_of(save_player(dance, tmp_path / "a.html", song, metrics=False))
    assert "<b>hum" not in text and data["title"].startswith("</script><b>hum")


def test_page_may_ask_for_nothing(dance, tmp_path):
    text, _ = data_of(save_player(dance, tmp_path / "a.html", metrics=False))
    assert "default-src 'none'" in text and 'src="' not in text and "<link" not in text


@pytest.mark.parametrize("rate", [6000, 88200, 96000, 192000])
def test_a_song_may_have_any_rate(rate):
    """MP3 has nine of them."""
    t = np.arange(rate) / rate
    hum = Music((0.3 * np.sin(2 * np.pi * 220 * t)).astype(np.float32)[:, None], rate, name="hum")
    sound, found = soundfile.read(io.BytesIO(mp3(hum, 1.5)))
    assert found == 48000 and len(sound) / found == pytest.approx(1.5, abs=0.06)
    assert np.abs(sound[:40000]).max() == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize("rate", MP3_RATES)
def test_a_browser_can_jump_in_the_sound(rate):
    """In an MP3 of a variable bit rate, which begins with "Xing", Chromium is up to 1.7 s off."""
    click = np.zeros((2 * rate, 2), np.float32)
    click[rate] = 0.9
    sound = mp3(Music(click, rate, name="click"), 2.0)
    assert b"Info" in sound[:1000] and b"Xing" not in sound[:1000]
    heard, _ = soundfile.read(io.BytesIO(sound))
    assert np.abs(heard[:, 0]).argmax() / rate == pytest.approx(1.0, abs=0.001)


def test_one_dancer_is_no_dancers(dance, tmp_path):
    _, data = data_of(save_player(dance.dancer(0), tmp_path / "a.html", metrics=False))
    assert data["title"] == "1 dancer"


def test_metrics_stand_below(dance, song, tmp_path):
    _, data = data_of(save_player(dance, tmp_path / "a.html", song))
    assert {"FSR", "PFC", "BAS"} <= {name for name, _ in data["panes"][0]["metrics"]}


def test_another_skeleton_has_no_body_to_show(tmp_path):
    two = Skeleton(("root", "tail"), (-1, 0), torch.zeros(2, 3))
    dance = Motion(torch.eye(3).expand(1, 4, 2, 3, 3), torch.zeros(1, 4, 3), skeleton=two)
    with pytest.raises(ValueError, match="SMPL-24"):
        save_player(dance, tmp_path / "a.html")


def test_two_dances_must_fit(dance, tmp_path):
    with pytest.raises(ValueError, match="num_frames=100"):
        save_player(dance, tmp_path / "a.html", other=dance.frames(0, 100))
    assert list(tmp_path.iterdir()) == []
