import sys

import numpy as np
import pytest
import torch
from PIL import Image

from dancediff.motion.motion import Motion
from dancediff.music.song import Music
from dancediff.viz import video
from dancediff.viz.palette import dancer_color, rgb

SMALL = (160, 90)


def line_up(n=2, f=15):
    root = torch.zeros(n, f, 3)
    root[..., 0] = 1.2 * torch.arange(n, dtype=torch.float32)[:, None]
    root[..., 1] = 0.95
    return Motion(torch.eye(3).expand(n, f, 24, 3, 3), root)


def rising_tone(seconds=3.0, rate=22050):
    """A tone that begins at 0.25 s, so that a shift of the sound can be seen."""
    time = np.arange(round(seconds * rate)) / rate
    return Music(0.5 * np.sin(2 * np.pi * 440 * time) * (time >= 0.25), rate, "tone")


def where(picture, k):
    """Mean column of the pixels in the colour of dancer k."""
    away = np.abs(picture[..., :3] / 255 - np.array(rgb(dancer_color(k)))).max(-1)
    columns = np.nonzero(away < 0.04)[1]
    assert len(columns) > 20
    return columns.mean()


def test_left_of_the_stage_is_left_in_the_picture():
    picture = video.Canvas(line_up(), size=(320, 180)).frame(0)
    assert where(picture, 0) < 160 < where(picture, 1)


def test_the_same_dance_gives_the_same_bits():
    first, second = (video.Canvas(line_up(), size=SMALL).frame(3).copy() for _ in range(2))
    assert np.array_equal(first, second)


def test_a_beat_shows_and_fades(monkeypatch):
    song = rising_tone()
    monkeypatch.setattr(Music, "beats", lambda self: np.array([0.2]))
    canvas = video.Canvas(line_up(), song, size=SMALL)
    assert canvas._beat(0.1) == (0.0, 0)
    assert canvas._beat(0.2) == (pytest.approx(1.0), 1)
    assert canvas._beat(0.35)[0] == pytest.approx(0.5)
    assert canvas._beat(0.6) == (0.0, 1)
    assert not np.array_equal(canvas.frame(5).copy(), canvas.frame(6))  # before and on the beat


def test_mp4_has_all_frames_and_the_song_in_time(tmp_path):
    av = pytest.importorskip("av")
    motion, song = line_up(f=30), rising_tone()
    video.save_video(motion, tmp_path / "dance.mp4", song=song, size=SMALL)
    assert [p.name for p in tmp_path.iterdir()] == ["dance.mp4"]
    with av.open(str(tmp_path / "dance.mp4")) as file:
        assert [s.codec_context.name for s in file.streams] == ["h264", "aac"]
        pictures = list(file.decode(video=0))
    assert len(pictures) == 30 and (pictures[0].width, pictures[0].height) == SMALL
    assert pictures[-1].time == pytest.approx(29 / 30, abs=1e-3)
    with av.open(str(tmp_path / "dance.mp4")) as file:
        sound = list(file.decode(audio=0))
    samples = np.concatenate([frame.to_ndarray()[0] for frame in sound])
    start = sound[0].time * 48000
    heard = (np.flatnonzero(np.abs(samples) > 0.2)[[0, -1]] + start) / 48000
    assert heard[0] == pytest.approx(0.25, abs=0.03)
    assert heard[1] == pytest.approx(1.0, abs=0.05)  # the song lasts 3 s, the dance 1 s


def test_mp4_without_a_song_is_silent(tmp_path):
    av = pytest.importorskip("av")
    line_up(f=3).save(tmp_path / "dance.mp4")
    with av.open(str(tmp_path / "dance.mp4")) as file:
        assert [s.type for s in file.streams] == ["video"]


def test_gif(tmp_path):
    video.save_video(line_up(f=15), tmp_path / "dance.gif", size=SMALL, fps=10)
    with Image.open(tmp_path / "dance.gif") as picture:
        assert picture.size == SMALL
        assert picture.info["duration"] == 100
    assert [p.name for p in tmp_path.iterdir()] == ["dance.gif"]


def test_without_av_the_extra_is_named_and_gif_still_works(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ImportError, match=r'pip install "dancediff\[video\]"'):
        video.save_video(line_up(), tmp_path / "dance.mp4", size=SMALL)
    assert list(tmp_path.iterdir()) == []
    video.save_video(line_up(f=3), tmp_path / "dance.gif", size=SMALL)
    assert (tmp_path / "dance.gif").read_bytes()[:3] == b"GIF"


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_failure_keeps_the_old_file_and_leaves_nothing(tmp_path, monkeypatch, suffix):
    if suffix == ".mp4":
        pytest.importorskip("av")
    draw = video.Canvas.frame

    def break_off(self, position):
        if position >= 5:
            raise OSError("disk full")
        return draw(self, position)

    old = tmp_path / f"dance{suffix}"
    old.write_bytes(b"old")
    monkeypatch.setattr(video.Canvas, "frame", break_off)
    with pytest.raises(OSError, match="disk full"):
        video.save_video(line_up(), old, size=SMALL)
    assert old.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == [old.name]


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("dance.avi", {}, "suffix '.avi'"),
        ("dance.mp4", {"size": (161, 90)}, "size="),
        ("dance.gif", {"fps": -1}, "fps=-1"),
    ],
)
def test_bad_arguments_are_named(tmp_path, name, options, message):
    with pytest.raises(ValueError, match=message):
        video.save_video(line_up(), tmp_path / name, **options)
    assert list(tmp_path.iterdir()) == []
