"""The tracker of music that goes on, against the tracker of whole songs and known beats."""

import numpy as np
import pytest

from dancediff.music.beat_tracking import BEAT_FPS, ON_BEAT, _TempoModel, beat_activation
from dancediff.music.next_beat import beat_line, coming_beats
from dancediff.music.online_beats import PAST, OnlineBeats


def clicks(times, seconds: float, seed: int = 0) -> np.ndarray:
    """An envelope with a peak of three frames at each time, over a little noise."""
    onset = 0.05 * np.random.default_rng(seed).random(round(seconds * BEAT_FPS))
    for at in np.round(np.asarray(times) * BEAT_FPS).astype(int):
        onset[at : at + 3] += np.array([1.0, 0.6, 0.2])[: max(0, len(onset) - at)]
    return onset


def heard(onset: np.ndarray) -> OnlineBeats:
    tracker = OnlineBeats()
    for value in onset:
        tracker.push(float(value))
    return tracker


@pytest.mark.parametrize("tempo", [76, 120, 147, 188])
def test_beats_are_known_while_they_come_and_before_they_come(tempo):
    truth = np.arange(0.4, 40, 60 / tempo)
    tracker, onset = OnlineBeats(), clicks(truth, 40)
    for f, value in enumerate(onset):
        tracker.push(float(value))
        if f >= 8 * BEAT_FPS and f % 50 == 0:
            now, known = f / BEAT_FPS, tracker.beats().times
            assert now - known[-1] < 1.3 * 60 / tempo
            ahead = coming_beats(known, now, now + 3)
            ahead = ahead[ahead < truth[-1] + 0.1]
            assert len(ahead) >= 3 * tempo / 60 - 1.01 or now > 36
            assert (
                np.abs(ahead[:, None] - truth).min(1).max(initial=0) < 60 / tempo / ON_BEAT + 0.03
            )


def test_with_the_same_activation_it_finds_what_the_tracker_of_whole_songs_finds(monkeypatch):
    onset = clicks([*np.arange(2, 8, 0.5), *np.arange(12, 18, 0.41)], 18)
    a = beat_activation(onset)
    whole, _ = _TempoModel(a).explain()
    tracker = OnlineBeats()
    monkeypatch.setattr(tracker._activation, "push", lambda value: value)
    for value in a:
        tracker.push(float(value))
    found, _ = tracker._back()
    assert found[:-2] == whole[: len(found) - 2].tolist()
    assert len(whole) - len(found) in (0, 1)  # the last one may not have been heard yet


def test_music_without_a_beat_has_none():
    rng = np.random.default_rng(2)
    for onset in (np.zeros(1200), clicks(np.cumsum(rng.uniform(0.2, 2.5, 20)), 20)):
        tracker = heard(onset)
        assert len(tracker.beats().times) == 0 and not tracker.has_beat


def test_the_beat_stops_and_sets_in_again():
    tracker = heard(clicks(np.arange(1, 10, 0.5), 24))
    assert not tracker.has_beat and tracker.beats().times.max() < 11
    again = heard(clicks([*np.arange(1, 10, 0.5), *np.arange(20, 30, 0.4)], 30))
    assert again.has_beat and len(again.beats().times) > 20


def test_only_the_last_seconds_are_kept():
    tracker = heard(clicks(np.arange(0, 60, 0.5), 60))
    times, sure = tracker.beats().times, tracker.beats().confidence
    assert 60 - PAST <= times[0] < 62 - PAST and len(times) == len(sure) and sure.min() > 0.4
    assert np.abs(times * 2 - np.round(times * 2)).max() < 0.05


def test_nothing_was_heard():
    assert len(OnlineBeats().beats().times) == 0


def test_a_beat_line_is_exact_for_an_even_beat_with_gaps():
    k = np.array([0, 1, 2, 4, 5, 8])
    t, T = beat_line(3 + 0.47 * k)
    assert (t, T) == (pytest.approx(3 + 0.47 * 8), pytest.approx(0.47))
    np.testing.assert_allclose(coming_beats(3 + 0.47 * k, 7.0, 8.0), 3 + 0.47 * np.array([9, 10]))


def test_without_a_pace_no_beat_comes():
    for known in (np.zeros(0), np.array([1.0, 2.0])):
        assert len(coming_beats(known, 0.0, 5.0)) == 0
