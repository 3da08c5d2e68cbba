"""Augmented songs: beats move with the tempo, pitch with the pitch, and each step does its own."""

import numpy as np
import pytest

from dancediff.music import augment
from dancediff.music.augment import SHARES, augment_song, faster_and_higher
from dancediff.music.instruments import RATE
from dancediff.music.song import Music
from dancediff.music.synth import synth_song


@pytest.fixture(scope="module")
def song():
    return synth_song(3, seconds=12, tempo=100)


def only(monkeypatch, *steps):
    monkeypatch.setattr(augment, "SHARES", {name: float(name in steps) for name in SHARES})


def spectrum(y):
    return np.abs(np.fft.rfft(y * np.hanning(len(y))))


def test_the_same_generator_gives_the_same_version(song):
    a, b, c = (augment_song(song[0], np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(a[0].audio, b[0].audio) and a[1] == b[1]
    assert a[1] != c[1] or not np.array_equal(a[0].audio, c[0].audio)


def test_versions_are_sound():
    song, _ = synth_song(5, seconds=6)
    for seed in range(12):
        version, change = augment_song(song, np.random.default_rng(seed))
        assert version.audio.shape[1] == 1 and np.abs(version.audio).max() <= 1
        assert version.duration == pytest.approx(6 / change.speed, abs=0.05)


@pytest.mark.parametrize("seed", [0, 3, 4])
def test_beats_move_with_the_tempo(song, monkeypatch, seed):
    """Onsets of the new version lie at the moved beats, and not at the old ones."""
    only(monkeypatch, "tempo", "pitch", "shelf", "codec")
    music, truth = song
    version, change = augment_song(music, np.random.default_rng(seed))
    assert abs(change.speed - 1) > 0.01
    onset = version.features()[:, 0].numpy()

    def strength(times):
        frames = np.round(times * 30).astype(int)
        frames = frames[(frames > 0) & (frames < len(onset) - 1)]
        return np.max([onset[frames + k] for k in (-1, 0, 1)], axis=0).mean()

    moved = change.times(truth.beats, version.duration)
    assert np.allclose(np.diff(moved), 0.6 / change.speed)
    assert strength(moved) > 2 * strength(moved + 0.37 * 0.6)
    late = moved[moved > 6] * change.speed
    assert strength(moved[moved > 6]) > 1.2 * strength(late)


def test_a_cut_song_begins_later(monkeypatch):
    only(monkeypatch, "crop")
    music, truth = synth_song(6, seconds=50, tempo=90)
    version, change = augment_song(music, np.random.default_rng(0))
    assert change.start > 0 and version.duration == pytest.approx(50 - change.start, abs=0.01)
    beats = change.times(truth.beats, version.duration)
    assert beats.min() >= 0 and len(beats) < len(truth.beats)
    old = music.mono(RATE)[round(change.start * RATE) :]
    assert np.corrcoef(old, version.audio[:, 0])[0, 1] > 0.999


@pytest.mark.parametrize(("speed", "semitones"), [(1.0, 3.0), (1.1, 0.0), (0.9, -2.0)])
def test_tempo_and_pitch_change_independently(speed, semitones):
    y = np.sin(2 * np.pi * 440 * np.arange(4 * RATE) / RATE).astype(np.float32)
    z = faster_and_higher(y, speed, semitones)
    assert len(y) / len(z) == pytest.approx(speed, rel=0.01)
    pitch = spectrum(z).argmax() * RATE / len(z)
    assert pitch == pytest.approx(440 * 2 ** (semitones / 12), rel=0.01)


@pytest.mark.parametrize("name", augment._STEPS)
def test_every_step_keeps_time_and_changes_sound(song, name):
    y = song[0].mono(RATE)
    y = y / np.abs(y).max()
    z = augment._STEPS[name](y.copy(), np.random.default_rng(2))
    assert len(z) == len(y) and np.isfinite(z).all()
    assert 1 - np.corrcoef(y, z)[0, 1] > 1e-4 or np.abs(y - z).max() > 0.01
    lags = np.correlate(z[2 * RATE : 6 * RATE], y[2 * RATE + 500 : 6 * RATE - 500], "valid")
    assert abs(int(np.abs(lags).argmax()) - 500) <= 15  # under a millisecond


def test_steps_do_what_they_are_called(song):
    y = song[0].mono(RATE)
    y = y / np.abs(y).max()
    spread = lambda x: np.percentile(np.abs(x), 99) / np.percentile(np.abs(x), 50)  # noqa: E731
    assert spread(augment.compression(y, np.random.default_rng(0))) < 0.7 * spread(y)
    beep = np.zeros(2 * RATE)
    beep[:100] = 1
    assert np.abs(augment.room(beep, np.random.default_rng(0))[400:2000]).max() > 1e-3
    for seed in range(4):  # lossy, and still the song
        back = augment.codec(y, np.random.default_rng(seed))
        assert 0.01 < np.sqrt(np.mean((back - 0.95 * y) ** 2) / np.mean(y**2)) < 0.7


def test_silence_is_refused():
    with pytest.raises(ValueError, match="'still' is silent"):
        augment_song(Music(np.zeros(RATE), RATE, "still"), np.random.default_rng(0))
