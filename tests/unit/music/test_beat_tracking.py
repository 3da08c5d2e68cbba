"""The tracker against songs made of clicks, music without a beat, and a plain form of itself."""

import numpy as np
import pytest

from dancediff.music import beat_tracking as bt
from dancediff.music.beat_tracking import BEAT_FPS, beat_activation, beat_onset, track_beats
from dancediff.music.synth import synth_song


def onsets(times, seconds: float, seed: int = 0) -> np.ndarray:
    """An envelope with a peak at each time, over a little noise."""
    rng = np.random.default_rng(seed)
    onset = 0.05 * rng.random(round(seconds * BEAT_FPS))
    for time in times:
        k = round(time * BEAT_FPS)
        onset[k : k + 3] += np.array([1.0, 0.6, 0.2])[: max(0, len(onset) - k)]
    return onset


@pytest.mark.parametrize("tempo", [76, 90, 120, 147, 188])
def test_an_even_beat_is_found(tempo):
    truth = np.arange(0.4, 30, 60 / tempo)
    found = track_beats(onsets(truth, 30))
    assert len(found.times) == pytest.approx(len(truth), abs=1)
    # a beat lies where the part of its interval that is on the beat begins
    assert np.abs(found.times[:, None] - truth).min(1).max() <= 60 / tempo / bt.ON_BEAT
    assert found.confidence.min() > 0.4


def test_a_change_of_tempo_is_followed():
    gaps = 60 / np.linspace(100, 140, 60)
    truth = 0.3 + np.cumsum(gaps)
    found = track_beats(onsets(truth, truth[-1] + 1)).times
    assert len(found) == pytest.approx(len(truth), abs=2)
    assert np.mean(np.abs(found[:, None] - truth).min(1) <= 3 / BEAT_FPS) > 0.95


def test_uneven_onsets_have_no_beat():
    for seed in range(4):
        rng = np.random.default_rng(seed)
        times = np.cumsum(rng.uniform(0.2, 2.5, 25))
        assert len(track_beats(onsets(times, 30, seed)).times) == 0
    assert len(track_beats(np.zeros(2000)).times) == 0
    assert len(track_beats(np.zeros(0)).times) == 0


def test_noise_and_silence_have_no_beat():
    noise = np.random.default_rng(0).normal(size=15360 * 15).astype(np.float32)
    for sound in (0.1 * noise, np.zeros(15360 * 5, dtype=np.float32)):
        assert len(track_beats(beat_onset(sound)).times) == 0


def test_a_beat_that_sets_in_late_and_pauses():
    first, second = np.arange(8, 16, 0.5), np.arange(24, 32, 0.5)
    rng = np.random.default_rng(1)
    uneven = [*np.cumsum(rng.uniform(0.5, 2.5, 5)), *(16 + np.cumsum(rng.uniform(0.5, 2.5, 5)))]
    found = track_beats(onsets([*uneven, *first, *second], 32)).times
    assert found.min() > 7
    assert np.sum((found > 18) & (found < 23)) <= 2  # had it gone on: 10
    for part in (first, second):
        assert np.abs(part[1:-1, None] - found).min(1).max() <= 2 / BEAT_FPS


def test_synthetic_songs():
    song, truth = synth_song(920_001, seconds=20)
    found = track_beats(beat_onset(song.mono())).times
    assert np.mean(np.abs(truth.beats[:, None] - found).min(1) < 0.07) > 0.9
    assert np.mean(np.abs(found[:, None] - truth.beats).min(1) < 0.07) > 0.9


def plain(a: np.ndarray) -> float:
    """Score of the best explanation, frame by frame and tempo by tempo."""
    model = bt._TempoModel(a)
    tau, F = model.tau, len(a)
    start, stop = np.log(bt.SWITCH / len(tau)), np.log(bt.SWITCH)
    ended = np.full((F + tau.max() + 1, len(tau)), -np.inf)
    R, best = 0.0, -np.inf
    for f in range(F):
        for i in range(len(tau)):
            scores = [ended[f, j] + model.change[j, i] for j in range(len(tau))]
            D = max(*scores, R + start) + model.intervals(np.array([f]))[0, i]
            ended[f + tau[i], i] = D
            if f + tau[i] >= F:
                best = max(best, D)
        R = max(R, ended[f].max() + stop) + model.none[f + 1] - model.none[f]
    return max(best, R)


def score_of(a: np.ndarray, frames: np.ndarray) -> float:
    """Score of the explanation with these beats, without a pause between them."""
    model = bt._TempoModel(a)
    tau = list(model.tau)
    start = np.log(bt.SWITCH / len(tau))
    total, before = model.none[frames[0]] + start, None
    for f, after in zip(frames, np.append(frames[1:], -1), strict=True):
        if after < 0:  # the last interval ends with the song, in whatever tempo is best
            ways = [
                model.intervals(np.array([f]))[0, i]
                + (0 if before is None else model.change[before, i])
                for i in range(len(tau))
                if f + tau[i] >= len(a)
            ]
            return total + max(ways)
        i = tau.index(after - f)
        total += model.intervals(np.array([f]))[0, i]
        total += 0 if before is None else model.change[before, i]
        before = i
    return total


def test_it_is_the_best_explanation(monkeypatch):
    monkeypatch.setattr(bt, "TEMPI", 8)
    a = beat_activation(onsets(np.arange(0.2, 6, 0.5), 6))
    frames, _ = bt._TempoModel(a).explain()
    assert score_of(a, frames) == pytest.approx(plain(a), abs=1e-6)


def test_in_parts_the_onsets_are_the_same():
    y = synth_song(3, seconds=12)[0].mono()
    np.testing.assert_allclose(beat_onset(y, at_once=140), beat_onset(y), atol=2e-3)
