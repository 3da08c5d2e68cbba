import threading

import numpy as np
import pytest
import soundfile

from dancediff.music.song import Music, as_song


def tone(rate, seconds=1.5, channels=2, hz=440):
    t = np.arange(int(rate * seconds)) / rate
    return np.repeat(0.5 * np.sin(2 * np.pi * hz * t)[:, None], channels, 1).astype(np.float32)


@pytest.mark.parametrize("suffix", ["wav", "flac", "ogg", "mp3"])
@pytest.mark.parametrize(("rate", "channels"), [(44100, 2), (22050, 1), (48000, 1)])
def test_formats_rates_channels(tmp_path, suffix, rate, channels):
    path = Music(tone(rate, channels=channels), rate).save(tmp_path / f"a.{suffix}")
    song = Music.load(path)
    assert song.rate == rate and song.audio.shape[1] == channels and song.name == "a"
    assert song.duration == pytest.approx(1.5, abs=0.1)
    mono = song.mono()
    assert abs(len(mono) - 15360 * song.duration) <= 1
    spectrum = np.abs(np.fft.rfft(mono))
    assert np.argmax(spectrum) * 15360 / len(mono) == pytest.approx(440, abs=2)
    assert [p.name for p in tmp_path.iterdir()] == [f"a.{suffix}"]


def test_high_sounds_do_not_alias():
    mono = Music(tone(44100, hz=12000), 44100).mono()
    assert np.abs(mono[500:-500]).max() < 0.01


@pytest.mark.parametrize("samples", [44100, 44101, 50000, 13, 22050])
def test_num_frames_is_the_number_of_feature_rows(samples):
    song = Music(tone(44100, 2)[:samples], 44100)
    assert song.num_frames == len(song.features())


def test_slice(tmp_path):
    song = Music(tone(10000, 2), 10000)
    assert song.slice(0.5, 1.0).duration == pytest.approx(0.5)
    assert song.slice(-1, float("inf")).duration == song.duration
    with pytest.raises(ValueError, match=r"lasts 2\.00"):
        song.slice(3, 4)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("none.wav", None, "does not exist"),
        ("empty.wav", b"", "empty"),
        ("text.mp3", b"hello world, this is no sound", "text.mp3"),
        ("half.ogg", b"OggS\0\2" + b"\0" * 90, "half.ogg"),
    ],
)
def test_bad_files_name_path_and_fix(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=message):
        Music.load(tmp_path / name)
    with pytest.raises(ValueError, match="is a folder"):
        Music.load(tmp_path)


def test_no_samples_and_nan_are_refused(tmp_path):
    soundfile.write(tmp_path / "zero.wav", np.zeros((0, 1), np.float32), 8000)
    with pytest.raises(ValueError, match="no samples"):
        Music.load(tmp_path / "zero.wav")
    soundfile.write(tmp_path / "nan.wav", np.full(100, np.nan, np.float32), 8000, subtype="FLOAT")
    with pytest.raises(ValueError, match="finite"):
        Music.load(tmp_path / "nan.wav")


def test_a_rate_is_a_whole_number_of_any_type(tmp_path):
    path = Music(tone(22050), 22050.0).save(tmp_path / "a.wav")
    assert (
        type(Music(tone(22050), np.float64(22050)).rate) is int and Music.load(path).rate == 22050
    )
    for rate in (0, 22050.5, float("inf"), float("nan")):
        with pytest.raises(ValueError, match=f"rate={rate} must be positive and whole"):
            Music(tone(22050), rate)


def test_silence():
    assert Music(np.full(1000, 5e-5, np.float32), 8000).is_silent
    assert not Music(np.full(1000, 5e-3, np.float32), 8000).is_silent
    wave = np.sin(np.arange(1000, dtype=np.float32))
    assert Music(np.stack([wave, -wave], axis=1), 8000).is_silent  # what is heard is their mean
    assert not Music(np.stack([wave, 0 * wave], axis=1), 8000).is_silent


def test_one_song_does_not_wait_for_the_features_of_another(monkeypatch):
    long, short = (Music(np.zeros(44100, dtype=np.float32), 44100, name) for name in "ab")
    begun, may_end, heard = threading.Event(), threading.Event(), {}

    def slow(song):
        if song is long:
            begun.set()
            assert may_end.wait(30)
        return song.name, None

    monkeypatch.setattr(Music._heard, "func", slow)
    thread = threading.Thread(target=lambda: heard.update(a=long.features()))
    thread.start()
    assert begun.wait(30)
    assert short.features() == "b" and "a" not in heard
    may_end.set()
    thread.join(30)
    assert heard == {"a": "a"} and long.features() == "a"


def test_channels_before_samples_are_refused_with_the_fix():
    """As librosa and torchaudio have them."""
    with pytest.raises(ValueError, match=r"\(2, 66150\), which would be 66150 channels.*audio\.T"):
        Music(tone(44100).T, 44100)


def test_a_path_is_the_song_in_it(tmp_path):
    path = Music(tone(22050), 22050).save(tmp_path / "a.wav")
    assert as_song(path).name == as_song(str(path)).name == "a"
    with pytest.raises(ValueError, match=r"nowhere\.wav' does not exist"):
        as_song("nowhere.wav")


def test_samples_without_their_rate_are_no_song():
    with pytest.raises(ValueError, match="song is a ndarray; give a Music or a path"):
        as_song(tone(44100))


def test_a_song_is_saved_to_a_new_folder_and_other_suffixes_are_refused(tmp_path):
    song = Music(np.zeros(22050, dtype=np.float32), 22050)
    assert Music.load(song.save(tmp_path / "new" / "a.wav")).duration == 1
    with pytest.raises(ValueError, match=r"suffix '\.m4a' of .* use \.wav \.flac \.ogg \.mp3"):
        song.save(tmp_path / "a.m4a")


@pytest.mark.parametrize("kind", [np.int16, np.int32])
def test_integer_samples_fill_the_range_as_files_do(tmp_path, kind):
    whole = np.round(tone(22050) * np.iinfo(kind).max).astype(kind)
    soundfile.write(tmp_path / "a.wav", whole, 22050, subtype=f"PCM_{8 * whole.itemsize}")
    song, read = Music(whole, 22050), Music.load(tmp_path / "a.wav")
    assert song.audio.dtype == np.float32 and song.peak == pytest.approx(0.5, abs=1e-3)
    assert np.abs(song.audio - read.audio).max() < 1e-6


@pytest.mark.parametrize("kind", [np.uint8, np.int8, np.int64, np.uint16, bool])
def test_other_integers_are_refused(kind):
    with pytest.raises(ValueError, match=rf"type {np.dtype(kind)}.*give int16 or int32, or floats"):
        Music(np.zeros(100, dtype=kind), 22050)


@pytest.mark.parametrize("suffix", ["wav", "mp3"])
def test_a_song_that_was_cut_off_says_so(tmp_path, suffix):
    path = Music(tone(44100, 3), 44100).save(tmp_path / f"a.{suffix}")
    assert Music.load(path).duration == pytest.approx(3, abs=0.1)  # warnings are errors
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.warns(UserWarning, match=rf"a.{suffix}' is cut off: it has 1\.\d s, 5\d% less"):
        assert Music.load(path).duration < 1.6


def test_a_length_that_its_writer_did_not_know_is_no_cut(tmp_path):
    path = Music(tone(44100, 1), 44100).save(tmp_path / "a.wav")
    data = bytearray(path.read_bytes())
    at = data.find(b"data")
    data[4:8] = data[at + 4 : at + 8] = b"\xff" * 4
    path.write_bytes(bytes(data))
    assert Music.load(path).duration == 1


@pytest.mark.parametrize("path", [None, 3])
def test_what_is_no_path_is_named(path):
    with pytest.raises(ValueError, match=rf"path is a {type(path).__name__}; give the path"):
        Music.load(path)
