"""Features of music that arrives, against those of the whole song and against known clicks."""

import numpy as np
import pytest
import torch

from dancediff.axes import FPS
from dancediff.music.causal import AHEAD, CausalMusic, continued
from dancediff.music.causal_frames import KEPT
from dancediff.music.energy import energy_curve
from dancediff.music.features import BEATS, CHROMA, MFCC, ONSET, PEAKS, music_features
from dancediff.music.online_beats import PAST
from dancediff.music.song import Music
from dancediff.music.sound_rate import HOP, SAMPLE_RATE
from dancediff.music.synth import synth_song

RATE = 22050


def everything(music: CausalMusic) -> torch.Tensor:
    start = music.first_frame
    return music.window(start, music.num_frames + AHEAD * FPS - start)


def clicks(seconds: float, gap: float, rate: int = RATE) -> np.ndarray:
    y = np.zeros(round(seconds * rate), np.float32)
    burst = np.random.default_rng(0).normal(size=rate // 50) * np.exp(-np.arange(rate // 50) / 80)
    for at in np.arange(0.5, seconds - 0.05, gap):
        y[round(at * rate) :][: len(burst)] += burst
    return y


@pytest.mark.parametrize("rate", [RATE, SAMPLE_RATE, 44100])
def test_blocks_of_any_length_give_the_same_bytes(rate):
    y = clicks(6, 0.5, rate)
    whole = CausalMusic(rate)
    whole.push(y)
    rng = np.random.default_rng(1)
    cut = CausalMusic(rate)
    for part in np.split(y, np.sort(rng.integers(0, len(y), 40))):
        cut.push(np.stack([part, part], axis=1) if rng.random() < 0.5 else part)
        if rng.random() < 0.2:
            everything(cut)  # asking changes nothing
    assert cut.num_frames == whole.num_frames
    assert torch.equal(everything(cut), everything(whole))
    assert cut.beats().tobytes() == whole.beats().tobytes()


def test_how_many_frames_are_known_is_a_matter_of_samples_alone():
    for rate in (RATE, 48000):
        music = CausalMusic(rate)
        for k in range(1, 60):
            music.push(np.zeros(rate // 20))
            late = k / 20 - music.now
            assert 0 <= late < 0.11  # a frame, the resampler's part and its reach
    exact = CausalMusic(SAMPLE_RATE)
    exact.push(np.zeros(10 * HOP + 511))
    assert exact.num_frames == 10


@pytest.fixture(scope="module")
def song() -> Music:
    return synth_song(920_003, seconds=18)[0]


@pytest.fixture(scope="module")
def heard(song) -> CausalMusic:
    music = CausalMusic(song.rate)
    music.push(song.audio)
    return music


def test_what_was_heard_has_the_features_of_the_whole_song(song, heard):
    frames = heard.num_frames - FPS
    ours, whole = heard.window(0, frames), song.features()[:frames]
    sounding = whole[:, MFCC.start] > whole[:, MFCC.start].median() - 300
    onsets = (ours[:, ONSET] - whole[:, ONSET]).abs()
    assert onsets.quantile(0.9) < 0.1 and onsets.max() < 1.5  # the loudest part is still to come
    assert (ours[:, MFCC] - whole[:, MFCC])[sounding].abs().mean() < 2
    assert (ours[:, CHROMA] * whole[:, CHROMA]).sum(1)[30:-30].median() > 0.97
    assert (ours[:, PEAKS] == whole[:, PEAKS]).float().mean() > 0.97
    assert (ours[:, BEATS] == whole[:, BEATS]).float().mean() > 0.95


def test_loudness_does_not_matter(song, heard):
    soft = CausalMusic(song.rate)
    soft.push(song.audio * 0.2)
    a, b = everything(soft)[:, MFCC], everything(heard)[:, MFCC]
    torch.testing.assert_close(a, b, atol=0.1, rtol=1e-3)


def test_clicks_are_foretold():
    gap, music = 0.5, CausalMusic(RATE)
    music.push(clicks(12.2, gap))
    beats = music.beats()
    to_come = beats[beats > music.now]
    truth = np.arange(0.5, 20, gap)
    assert len(to_come) == AHEAD / gap
    assert np.abs(to_come[:, None] - truth).min(1).max() < 0.03
    assert music.tempo == pytest.approx(120, rel=0.01)
    assert len(beats) == len(music.beat_confidence())
    M, now = everything(music), music.num_frames - music.first_frame
    onset = M[:, ONSET].flatten()
    assert (
        torch.corrcoef(torch.stack([onset[now - 90 : now - 30], onset[now + 30 : now + 90]]))[0, 1]
        > 0.8
    )  # four beats apart
    assert M[now + 5 :, PEAKS].sum() >= 8 and M[now:, BEATS].sum() == pytest.approx(10, abs=1)


def test_energy_is_that_of_the_features(heard, song):
    ours = heard.energy(0, heard.num_frames)
    assert ours.shape == (heard.num_frames,) and ours.min() >= 0 and ours.max() <= 1
    whole = energy_curve(song.features())[: heard.num_frames]
    assert (ours - whole)[: -2 * FPS].abs().mean() < 0.05


def test_memory_is_that_of_a_fixed_past():
    music, y = CausalMusic(SAMPLE_RATE), clicks(PAST + 8, 0.5, SAMPLE_RATE)
    music.push(y)
    assert music.first_frame == music.num_frames - 1 - KEPT
    assert music.window(music.first_frame, 30).shape == (30, 35)
    with pytest.raises(ValueError, match=f"frames {music.first_frame} to"):
        music.window(music.first_frame - 1, 30)
    with pytest.raises(ValueError, match="ask for some of them"):
        music.window(music.num_frames + 121, 30)
    whole, first = torch.from_numpy(music_features(y)), music.first_frame
    kept = music.window(first, KEPT - FPS)
    torch.testing.assert_close(kept[:, ONSET], whole[first:][: len(kept), ONSET], atol=1e-2, rtol=0)


def test_silence_and_nothing_at_all_are_finite():
    music = CausalMusic(RATE)
    assert torch.isfinite(everything(music)).all() and np.isnan(music.tempo)
    assert music.energy(0, 150).tolist() == [0] * 150
    music.push(np.zeros(RATE * 2))
    assert torch.isfinite(everything(music)).all() and len(music.beats()) == 0
    assert everything(music)[:, [0, 33, 34]].abs().max() == 0


def test_what_is_no_sound_is_refused():
    music = CausalMusic(RATE)
    with pytest.raises(ValueError, match="finite"):
        music.push([0.0, np.nan])
    with pytest.raises(ValueError, match="shape"):
        music.push(np.zeros((3, 2, 1)))
    with pytest.raises(ValueError, match=r"shape \(2, 4410\).*not \(channels, n\)"):
        music.push(np.zeros((2, 4410)))  # one block would be two samples of 4410 channels
    for rate in (0, 22050.5):
        with pytest.raises(ValueError, match=f"rate={rate}"):
            CausalMusic(rate)
    CausalMusic(22050.0).push(np.zeros(4410))


def test_a_bar_is_repeated_in_phase():
    bar = 7.3
    X = np.sin(2 * np.pi * np.arange(60) / bar)[:, None]
    later = continued(X, 120, bar)
    truth = np.sin(2 * np.pi * np.arange(120) / bar)[:, None]
    assert np.abs(later - truth).max() < 2 * np.pi / bar / 2 + 1e-6  # half a frame off at most
    np.testing.assert_array_equal(continued(X, 60, bar), X)
