"""The energy curve: level beside the song's own, whatever the gain and the length."""

import numpy as np
import pytest
import torch

from dancediff.music.energy import EVEN, SLOPE, energy_curve
from dancediff.music.features import MFCC, NUM_FEATURES, SAMPLE_RATE
from dancediff.music.song import Music


def song_at(levels) -> torch.Tensor:
    """Features of a song whose frames have these levels in dB, all of the same timbre."""
    M = torch.zeros(len(levels), NUM_FEATURES)
    M[:, MFCC.start + 1 : MFCC.stop] = torch.linspace(40, -5, 19)
    M[:, MFCC.start] = torch.as_tensor(levels, dtype=torch.float32) * 128**0.5
    return M


def test_a_song_that_is_always_equally_loud_is_flat():
    torch.testing.assert_close(energy_curve(song_at(np.zeros(400))), torch.full((400,), EVEN))


def test_louder_is_never_less_energy():
    curve = energy_curve(song_at(np.linspace(-40, 10, 600)))
    assert (curve.diff() >= 0).all() and curve[-1] > curve[0] + 0.5
    assert 0 <= curve.min() and curve.max() <= 1


def test_the_slope_is_fixed_in_decibels():
    for step in (2.0, 6.0):
        curve = energy_curve(song_at(np.repeat([0.0, step], 300)))
        assert curve[450] - curve[150] == pytest.approx(step / SLOPE, abs=1e-3)


def test_a_constant_gain_changes_nothing():
    levels = 8 * np.sin(np.arange(900) / 40)
    torch.testing.assert_close(energy_curve(song_at(levels)), energy_curve(song_at(levels - 30)))


def test_silence_has_none_and_changes_nothing_beside_it():
    levels = 8 * np.sin(np.arange(900) / 40)
    silent = torch.cat([song_at(levels), song_at(np.full(600, -140.0))])
    curve = energy_curve(silent)
    torch.testing.assert_close(curve[:880], energy_curve(song_at(levels))[:880])
    assert curve[920:].max() == 0
    assert energy_curve(song_at(np.full(50, -140.0))).max() == 0


@pytest.mark.parametrize("frames", [1, 2, 14, 16, 30])
def test_short_songs(frames):
    curve = energy_curve(song_at(np.zeros(frames)))
    assert curve.shape == (frames,) and torch.isfinite(curve).all()


def test_an_hour_and_parts_of_it_agree():
    levels = np.random.default_rng(0).normal(size=108_000)
    curve = energy_curve(song_at(levels))
    assert curve.shape == (108_000,)
    # noise of one level throughout: a part has the mean level of the whole
    assert (
        energy_curve(song_at(levels[:20_000]))[100:19_000] - curve[100:19_000]
    ).abs().max() < 0.01


def test_it_follows_the_sound():
    """Noise that swells and dies away, recorded with two gains, and then silence."""
    noise = np.random.default_rng(1).normal(size=20 * SAMPLE_RATE)
    swell = 10 ** (np.sin(np.arange(len(noise)) / SAMPLE_RATE) / 2)  # 20 dB between its ends
    y = (0.01 * noise * swell).astype(np.float32)
    curves = [energy_curve(Music(gain * y, SAMPLE_RATE).features()) for gain in (1.0, 0.1)]
    torch.testing.assert_close(curves[0], curves[1], atol=0.01, rtol=0)
    t = torch.arange(len(curves[0])) / 30
    assert torch.corrcoef(torch.stack([curves[0], t.sin()]))[0, 1] > 0.98
    assert energy_curve(Music(np.zeros(9999), SAMPLE_RATE).features()).max() == 0


@pytest.mark.parametrize("shape", [(0, 35), (35,), (4, 34)])
def test_what_is_no_song_is_refused(shape):
    with pytest.raises(ValueError, match="M has shape"):
        energy_curve(torch.zeros(shape))
