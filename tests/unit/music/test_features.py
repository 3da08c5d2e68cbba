import numpy as np
import pytest
import torch

from dancediff.music.features import (
    BEATS,
    CHROMA,
    LATE,
    MFCC,
    ONSET,
    PEAKS,
    SAMPLE_RATE,
    MusicNormalizer,
    _pitches,
    beat_times,
    music_features,
)
from dancediff.music.librosa_import import import_librosa
from dancediff.music.song import Music
from dancediff.music.synth import synth_song


@pytest.fixture(scope="module")
def song():
    return synth_song(1, seconds=12, tempo=120)


def test_slices_cover_35_columns_once():
    taken = [k for s in (ONSET, MFCC, CHROMA, PEAKS, BEATS) for k in range(35)[s]]
    assert taken == list(range(35))


@pytest.mark.parametrize("n", [1, 511, 512, 1536, 15360, 40001])
def test_exactly_one_row_a_hop(n):
    y = np.random.default_rng(0).normal(size=n).astype(np.float32)
    M = music_features(y)
    assert M.shape == (1 + n // 512, 35) and np.isfinite(M).all()


def test_binary_columns_and_number_of_beats(song):
    M = song[0].features().numpy()
    for column in (33, 34):
        assert set(np.unique(M[:, column])) == {0, 1}
    assert M[:, 34].sum() == pytest.approx(len(song[1].beats), abs=1)
    times = beat_times(song[0].features())
    np.testing.assert_allclose(times, song[0].beats()[: len(times)], atol=0.5 / 30 + 1e-6)
    assert len(song[0].beat_confidence()) == len(song[0].beats())
    assert song[0].beat_confidence().min() > 0.5


def test_onsets_peaks_and_beats_keep_the_same_time():
    """Each of the three columns is LATE after the click that it tells of, to a frame."""
    clicks = np.arange(1, 19, 0.55)
    y = np.zeros(20 * SAMPLE_RATE, dtype=np.float32)
    decay = np.random.default_rng(0).normal(size=1500) * np.exp(-np.arange(1500) / 300)
    for click in clicks:
        start = round(click * SAMPLE_RATE)
        y[start : start + 1500] = 0.3 * decay
    M = music_features(y)
    for column in (PEAKS, BEATS):
        late = np.flatnonzero(M[:, column]) / 30 - clicks[:, None]
        late = np.take_along_axis(late, np.abs(late).argmin(1)[:, None], 1)
        assert np.abs(late - LATE).max() < 1.01 / 30
    assert np.mean(M[np.flatnonzero(M[:, BEATS]), 0] > 0.25 * M[:, 0].max()) > 0.9


def test_a_fading_song_has_beats_to_its_end_and_none_in_silence():
    rate, period = SAMPLE_RATE, SAMPLE_RATE // 2  # 120 beats a minute
    y = np.zeros(40 * rate, dtype=np.float32)
    starts = np.arange(3 * rate, 33 * rate, period)  # 3 s of silence before, 7 s after
    loud = np.geomspace(1, 0.01, len(starts))
    click = np.sin(2 * np.pi * 440 * np.arange(2000) / rate) * np.exp(-np.arange(2000) / 400)
    for start, level in zip(starts, loud, strict=True):
        y[start : start + 2000] = level * click
    beats = np.flatnonzero(music_features(y)[:, BEATS].ravel()) / 30
    assert beats[0] == pytest.approx(3, abs=0.6)
    assert beats[-1] == pytest.approx(32.5, abs=0.6)
    assert np.diff(beats) == pytest.approx(0.5, abs=0.1)


def test_in_parts_it_is_the_same(song):
    y = song[0].mono()
    whole = music_features(y)
    for at_once in (50, 331):
        np.testing.assert_allclose(music_features(y, at_once=at_once), whole, atol=2e-3)


def test_silence_is_finite():
    assert np.isfinite(music_features(np.zeros(30000, dtype=np.float32))).all()


def test_the_whole_song_not_slices(song):
    """EDGE computes features per slice: at the cut its chroma and beats differ from the song's."""
    whole = song[0].features()[90:150]
    sliced = song[0].slice(3, 5).features()[:60]
    assert not torch.allclose(whole[:, CHROMA], sliced[:, CHROMA], atol=0.05)


def test_loudness_does_not_matter(song):
    soft = Music(song[0].audio * 0.1, song[0].rate)
    gap = (soft.features() - song[0].features()).abs()
    assert gap[:, 1:33].max() < 0.05 * song[0].features()[:, 1:33].abs().max()
    assert gap[:, 34].sum() == 0


def test_normalizer_keeps_unseen_songs_in_range(song, real_data):
    norm = MusicNormalizer.fit([synth_song(s, seconds=12)[0].features() for s in range(12)])
    real = Music.load(real_data / "music" / "hr3-caves.ogg").slice(0, 20).features()
    x = norm.normalize(real)
    assert x[:, :33].abs().max() <= 4 and set(x[:, 33:].unique().tolist()) <= {0, 1}
    cut = ((real - norm.mean) / norm.std)[:, :33].abs() > 4
    assert cut.float().mean() < 0.02


def test_a_normalizer_without_chroma_hears_the_rest_as_before(song):
    M = song[0].features()
    whole = MusicNormalizer.fit([M])
    masked = whole.without(["chroma"])
    x, y = whole.normalize(M), masked.normalize(M)
    assert x[:, CHROMA].abs().max() > 1 and y[:, CHROMA].abs().max() < 1e-4
    rest = [k for k in range(M.shape[1]) if not CHROMA.start <= k < CHROMA.stop]
    assert torch.equal(x[:, rest], y[:, rest])
    with pytest.raises(ValueError, match="'colour' is not one of onset, mfcc"):
        whole.without(["colour"])


def test_bad_samples_are_named():
    with pytest.raises(ValueError, match="samples"):
        music_features(np.array([0.0, np.nan]))
    with pytest.raises(ValueError, match=r"\(2, 3\)"):
        music_features(np.zeros((2, 3)))


@pytest.mark.parametrize("hiss", [0.0, 0.2])
def test_pitches_are_those_of_the_whole_spectrum(song, hiss):
    """The upper half of the bins is left out, but for what it says of loudness."""
    librosa = import_librosa()
    y = song[0].mono()
    noise = np.random.default_rng(0).standard_normal(len(y) + 2, dtype=np.float32)
    S = np.abs(librosa.stft(y + hiss * np.diff(noise, 2), n_fft=2048, hop_length=512))
    pitch, strength = librosa.piptrack(S=S, sr=SAMPLE_RATE, n_fft=2048)
    found, loud = _pitches(S)
    np.testing.assert_array_equal(found, pitch[pitch > 0])
    np.testing.assert_array_equal(loud, strength[pitch > 0])
    own, _ = librosa.piptrack(S=S[:535], sr=SAMPLE_RATE * 1068 / 2048, n_fft=1068)
    assert (hiss > 0) == (np.count_nonzero(own) > len(found)), "hiss hides soft pitches"


def test_a_normaliser_of_music_is_fitted_to_a_list_of_songs():
    M = torch.zeros(9, 35)
    for songs in ([], M):
        with pytest.raises(ValueError, match="songs must be a list"):
            MusicNormalizer.fit(songs)
    with pytest.raises(ValueError, match="songs has NaN"):
        MusicNormalizer.fit([M, M * float("nan")])
