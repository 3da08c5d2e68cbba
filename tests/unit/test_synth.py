import numpy as np
import pytest

from dancediff.music.beats import beat_f_score
from dancediff.music.synth import synth_song


def test_same_seed_same_bytes_other_seed_other_song():
    a, b, c = (synth_song(s, seconds=5)[0].audio for s in (1, 1, 2))
    assert np.array_equal(a, b) and not np.allclose(a, c, atol=1e-3)
    assert np.abs(a).max() <= 1 and np.isfinite(a).all()


def test_truth_is_a_grid():
    song, truth = synth_song(4, seconds=20, tempo=100)
    assert np.allclose(np.diff(truth.beats), 0.6) and truth.beats[0] < 0.6
    assert np.array_equal(truth.downbeats, truth.beats[::4])
    assert truth.sections[0][0] == truth.beats[0] and truth.sections[-1][1] == pytest.approx(20)
    assert song.duration == 20


def test_the_tracker_finds_the_true_beats():
    scores = []
    for seed in range(8):
        song, truth = synth_song(seed, seconds=20)
        scores.append(beat_f_score(song.beats(), truth.beats, tolerance=0.07))
    assert np.mean(scores) > 0.85


def test_timbre_varies():
    mean = [synth_song(s, seconds=6)[0].features()[:, 1:14].mean(0).numpy() for s in range(6)]
    gaps = [np.linalg.norm(a - b) for i, a in enumerate(mean) for b in mean[:i]]
    assert min(gaps) > 10


@pytest.mark.parametrize("bad", [{"seconds": 0}, {"tempo": 20.0}, {"tempo": 300.0}])
def test_bad_arguments_are_named(bad):
    with pytest.raises(ValueError, match=f"{next(iter(bad))}="):
        synth_song(0, **bad)
