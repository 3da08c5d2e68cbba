"""A long song's sound stays in its file; what is heard of it is the same."""

import numpy as np
import pytest
import soundfile

from dancediff.data.cache import song_features
from dancediff.music import song as song_module
from dancediff.music.song import Music
from dancediff.music.sound_on_disk import SoundOnDisk
from dancediff.music.synth import synth_song


@pytest.fixture(scope="module")
def made():
    return synth_song(2, seconds=40)[0]


@pytest.fixture
def long(monkeypatch):
    """Every song is long, and read in many parts."""
    monkeypatch.setattr(song_module, "LONG", 1000)
    monkeypatch.setattr("dancediff.music.sound_on_disk.AT_ONCE", 50_000)


@pytest.mark.parametrize("suffix", ["wav", "flac", "ogg", "mp3"])
def test_same_song_from_disk_and_from_memory(made, tmp_path, long, monkeypatch, suffix):
    path = made.save(tmp_path / f"a.{suffix}")
    on_disk = Music.load(path)
    monkeypatch.setattr(song_module, "LONG", 1 << 40)
    in_memory = Music.load(path)
    assert isinstance(on_disk.audio, SoundOnDisk) and isinstance(in_memory.audio, np.ndarray)
    assert on_disk.audio.shape == in_memory.audio.shape
    assert on_disk.duration == in_memory.duration and on_disk.rate == in_memory.rate
    assert on_disk.peak == pytest.approx(in_memory.peak) and not on_disk.is_silent
    np.testing.assert_allclose(on_disk.mono(), in_memory.mono(), atol=1e-5)
    np.testing.assert_allclose(on_disk.features(), in_memory.features(), atol=2e-3)
    np.testing.assert_allclose(on_disk.beats(), in_memory.beats(), atol=1e-6)
    part = on_disk.slice(20, 21.5)
    assert isinstance(part.audio, np.ndarray)
    np.testing.assert_allclose(part.audio, in_memory.slice(20, 21.5).audio, atol=1e-6)


def test_saved_again_it_is_the_same(made, tmp_path, long):
    song = Music.load(made.save(tmp_path / "a.wav"))
    again = Music.load(song.save(tmp_path / "b.wav"))
    assert song.audio.digest() == again.audio.digest()
    np.testing.assert_array_equal(np.asarray(song.audio), np.asarray(again.audio))
    assert song_features(song).equal(song_features(again))


def test_channels_that_cancel_out_are_silent(tmp_path, long):
    wave = 0.5 * np.sin(np.arange(20_000, dtype=np.float32))
    song = Music(np.stack([wave, -wave], axis=1), 22050)
    on_disk = Music.load(song.save(tmp_path / "a.wav"))
    assert isinstance(on_disk.audio, SoundOnDisk) and on_disk.is_silent


def test_another_file_in_its_place_is_noticed(made, tmp_path, long):
    path = made.save(tmp_path / "a.wav")
    song = Music.load(path)
    made.slice(0, 10).save(path)
    with pytest.raises(ValueError, match="has changed since it was loaded"):
        song.features()
    path.unlink()
    with pytest.raises(ValueError, match="has changed since it was loaded"):
        song.slice(0, 1)


def test_numbers_that_are_none_and_damaged_files_are_refused(tmp_path, long):
    path = tmp_path / "a.wav"
    sound = np.zeros((5000, 1), np.float32)
    sound[4000] = np.nan
    soundfile.write(path, sound, 8000, subtype="FLOAT")
    with pytest.raises(ValueError, match="no finite numbers"):
        Music.load(path)
    path.write_bytes(b"RIFF" + b"x" * 5000)
    with pytest.raises(ValueError, match="cannot be read as sound"):
        Music.load(path)


def test_steps_are_refused(made, tmp_path):
    with pytest.raises(ValueError, match="step=2"):
        SoundOnDisk(made.save(tmp_path / "a.wav"))[::2]
