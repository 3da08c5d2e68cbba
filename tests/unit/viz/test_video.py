import sys

import numpy as np
import pytest
import torch
from PIL import Image

from dancediff.data.choreographer import choreograph
from dancediff.motion.motion import Motion
from dancediff.music.song import Music
from dancediff.viz import video
from dancediff.viz.palette import DANCER_COLORS, rgb

av = pytest.importorskip("av")
SMALL = (160, 90)


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.2, 3, 0.5), dancers=2, seed=1, seconds=1.5)[0]


def tone(seconds, rate=44100, channels=2):
    wave = 0.3 * np.sin(2 * np.pi * 440 * np.arange(round(seconds * rate)) / rate)
    return Music(np.repeat(wave[:, None], channels, 1).astype(np.float32), rate, "tone")


def decode(path):
    with av.open(str(path)) as file:
        frames = [f.to_ndarray(format="rgb24") for f in file.decode(video=0)]
        rate = float(file.streams.video[0].average_rate)
    with av.open(str(path)) as file:
        if not file.streams.audio:
            return frames, rate, None
        sound = [f.to_ndarray() for f in file.decode(audio=0)]
        seconds = sum(s.shape[1] for s in sound) / file.streams.audio[0].rate
    return frames, rate, (seconds, np.abs(np.concatenate(sound, 1)).max())


def test_film_has_every_frame_and_the_sound_for_its_length(dance, tmp_path):
    path = video.save_video(dance, tmp_path / "a.mp4", tone(5), size=SMALL)
    frames, rate, (seconds, peak) = decode(path)
    assert len(frames) == dance.num_frames == 45
    assert frames[0].shape == (90, 160, 3)
    assert rate == 30
    assert seconds == pytest.approx(1.5, abs=0.06)
    assert peak == pytest.approx(0.3, abs=0.05)
    assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]


@pytest.mark.parametrize("channels", [1, 2, 3])
@pytest.mark.parametrize("rate", [8000, 48000])
def test_any_song_can_be_muxed(dance, tmp_path, channels, rate):
    path = video.save_video(dance, tmp_path / "a.mp4", tone(0.7, rate, channels), size=SMALL)
    assert decode(path)[2][0] == pytest.approx(0.7, abs=0.06)  # the song ends first


def test_silent_film_has_no_audio_stream(dance, tmp_path):
    assert decode(dance.save(tmp_path / "a.mp4"))[2] is None


def test_fps_resamples_the_dance(dance, tmp_path):
    frames, rate, _ = decode(video.save_video(dance, tmp_path / "a.mp4", size=SMALL, fps=10))
    assert (len(frames), rate) == (15, 10)


def test_same_dance_same_bits(dance, tmp_path):
    files = [video.save_video(dance, tmp_path / f"{k}.mp4", tone(2), size=SMALL) for k in "ab"]
    assert files[0].read_bytes() == files[1].read_bytes()
    other = choreograph(np.arange(0.2, 3, 0.5), dancers=2, seed=2, seconds=1.5)[0]
    assert (
        video.save_video(other, tmp_path / "c.mp4", size=SMALL).read_bytes()
        != files[0].read_bytes()
    )


def test_frames_move_and_show_both_dancers(dance):
    canvas = video.Canvas(dance, size=(320, 180))
    first, last = canvas.frame(0).copy(), canvas.frame(44).copy()
    assert (first != last).mean() > 0.01
    for color in DANCER_COLORS[:2]:
        near = np.abs(first[..., :3] / 255 - rgb(color)).max(-1) < 0.12
        assert near.sum() > 100


def test_frames_between_frames_are_blended():
    motion = Motion(torch.eye(3).expand(1, 2, 24, 3, 3), torch.zeros(1, 2, 3))
    motion.root[0, 1, 0] = 0.4
    canvas = video.Canvas(motion, size=(320, 180))
    a, m, b = (_centre(canvas.frame(k)) for k in (0, 0.5, 1))
    assert a < m < b


def _centre(frame):
    near = np.abs(frame[..., :3] / 255 - rgb(DANCER_COLORS[0])).max(-1) < 0.12
    return np.flatnonzero(near.any(0)).mean()


def test_a_name_is_no_formula(dance):
    """Matplotlib would read what stands between two "$" as TeX, and refuse this."""
    canvas = video.Canvas(dance, Music(tone(1).audio, 44100, r"$\frac$"), size=SMALL)
    assert canvas.frame(0).shape == (90, 160, 4)


def test_a_long_name_leaves_room_for_the_clock():
    font = video._letters(19)
    short = video._shortened("long " * 60, font, 200)
    assert short.endswith("…") and 150 < font.getlength(short) <= 200
    assert video._shortened("short", font, 200) == "short"


def test_beats_pulse():
    motion = Motion(torch.eye(3).expand(1, 30, 24, 3, 3), torch.zeros(1, 30, 3))
    canvas = video.Canvas(motion, size=SMALL)
    canvas.beats = np.array([0.5])
    assert canvas._beat(0.4) == (0.0, 0)
    assert canvas._beat(0.5) == (1.0, 1)
    assert canvas._beat(0.95) == (0.0, 1)
    assert (canvas.frame(14).copy() != canvas.frame(15)).any()


def test_gif(dance, tmp_path):
    path = dance.save(tmp_path / "a.gif")
    with Image.open(path) as picture:
        assert picture.size == (480, 270)
        assert picture.n_frames == round(1.5 * 12.5)
        assert picture.info["duration"] == 80
    assert [p.name for p in tmp_path.iterdir()] == ["a.gif"]


@pytest.mark.parametrize(("fps", "wait"), [(30, 30), (15, 70), (24, 40), (12.5, 80), (60, 20)])
def test_a_gif_lasts_as_long_as_the_dance(dance, tmp_path, fps, wait):
    path = video.save_video(dance, tmp_path / "a.gif", size=SMALL, fps=fps)
    with Image.open(path) as picture:
        lasts = []
        for k in range(picture.n_frames):
            picture.seek(k)
            lasts.append(picture.info["duration"])
    assert set(lasts) <= {wait, 2 * wait}  # two frames alike are one
    assert abs(sum(lasts) - 1000 * dance.duration) <= wait / 2


def test_gif_needs_no_av(dance, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    assert video.save_video(dance, tmp_path / "a.gif", size=SMALL, fps=5).exists()


def test_missing_av_names_the_extra(dance, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ImportError, match=r'pip install "dancediff\[video\]"'):
        video.save_video(dance, tmp_path / "a.mp4", size=SMALL)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "more", "message"),
    [
        ("a.avi", {}, "suffix '.avi'"),
        ("a.mp4", {"size": (161, 90)}, r"size=\(161, 90\)"),
        ("a.mp4", {"size": (8, 8)}, r"size=\(8, 8\)"),
        ("a.mp4", {"fps": -1}, "fps=-1"),
    ],
)
def test_bad_requests_name_the_value(dance, tmp_path, name, more, message):
    with pytest.raises(ValueError, match=message):
        video.save_video(dance, tmp_path / name, **more)
    assert list(tmp_path.iterdir()) == []


def test_a_film_that_fails_half_way_leaves_the_old_file(dance, tmp_path, monkeypatch):
    path = tmp_path / "a.mp4"
    path.write_text("old")
    frame = video.Canvas.frame

    def fail(self, position):
        if position > 5:
            raise RuntimeError("light bulb")
        return frame(self, position)

    monkeypatch.setattr(video.Canvas, "frame", fail)
    with pytest.raises(RuntimeError, match="light bulb"):
        video.save_video(dance, path, tone(1), size=SMALL)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
