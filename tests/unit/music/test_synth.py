import numpy as np
import pytest
from scipy.signal import lfilter

from beat_score import beat_f_score
from dancediff.music import instruments
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


SOUND = {  # of seed: tempo, first beat in seconds, and every 24,000th sample of 6 s of the song
    1: (115.73294073141591, 0.443478229078372, [-0.00133425056, 0.00914857164, -0.0258789882,
        -0.0220335368, -0.0250761639, 0.246984795]),
    3: (89.31024836290472, 0.14318365014759965, [9.21847095e-05, 0.0103365453, -0.00386942434,
        0.0162046105, 0.034050785, 0.00218407344]),
    4: (142.4694785454868, 0.19380774137640883, [-1.07154801e-05, 0.605079889, -0.160275251,
        0.304904312, -0.0333862007, -0.266524255]),
    6: (117.36618979126048, 0.157938389266008, [-0.000388868328, 0.159191117, 3.63477047e-05,
        -0.102484442, -0.476657093, -0.202463776]),
}  # fmt: skip


@pytest.mark.parametrize("seed", SOUND)
def test_a_seed_keeps_its_song(seed):
    """Packaged models learned from these songs. (The last bit of a sine depends on the machine.)"""
    song, truth = synth_song(seed, seconds=6.0)
    tempo, beat, samples = SOUND[seed]
    assert (truth.tempo, truth.beats[0]) == pytest.approx((tempo, beat), rel=1e-12)
    assert np.allclose(song.audio[::24000, 0], samples, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("length", "delay"), [(5000, 243), (5000, 1000), (30, 31), (30, 30)])
def test_the_echo_is_the_filter_to_the_bit(length, delay):
    x = np.random.default_rng(delay).normal(size=length)
    comb = np.zeros(delay + 1)
    comb[0], comb[-1] = 1, -0.3
    assert np.array_equal(instruments.echo(x, delay, 0.3), lfilter([1.0], comb, x))
