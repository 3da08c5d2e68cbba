"""Beat phase, and that a network which has it hears beats and only beats."""

import numpy as np
import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.beat_phase import BeatPhase, beat_phase, beat_waves
from dancediff.extensions.parts import Pass
from dancediff.music.features import MusicNormalizer


def music(beats, frames=40):
    M = torch.zeros(1, frames, 35)
    M[0, list(beats), 34] = 1
    return M


def test_between_beats_phase_is_linear_at_any_tempo():
    beats = [3, 10, 20, 32]
    phase = beat_phase(music(beats))[0].numpy()
    wanted = np.interp(np.arange(3, 32), beats, np.arange(4)) % 1
    np.testing.assert_allclose(phase[3:32], wanted, atol=1e-6)


def test_before_the_first_and_after_the_last_beat_the_usual_period_goes_on():
    phase = beat_phase(music([12, 22, 32]))[0]
    torch.testing.assert_close(phase[:12], (torch.arange(12) - 12) / 10 % 1)
    torch.testing.assert_close(phase[32:], torch.arange(8) / 10)


def test_windows_of_a_batch_have_their_own_beats():
    both = torch.cat([music([0, 8, 16]), music([5, 25])])
    for row, alone in zip(beat_phase(both), both, strict=True):
        assert torch.equal(row, beat_phase(alone[None])[0])


def test_without_a_beat_there_is_no_clock():
    assert not beat_waves(music([])).any()
    one = beat_waves(music([7]))
    assert one.isfinite().all() and one[0, 7].tolist() == [0, 1, 0, 1]


def test_standardised_music_keeps_its_beats():
    M = torch.randn(200, 35)
    M[:, 34] = 0
    M[::15, 34] = 1
    normalized = MusicNormalizer.fit([M]).normalize(M)
    assert torch.equal(beat_phase(normalized[None]), beat_phase(M[None]))


@pytest.fixture(scope="module")
def part():
    torch.manual_seed(0)
    return BeatPhase(16)


def added(part, h, M, mask=None):
    conditions = Conditions(M, music_mask=mask)
    return part.tokens(h, Pass(h, torch.ones(len(h)), conditions, normalizer=None)) - h


def test_tokens_are_told_the_beat_only_where_there_is_music(part):
    h = torch.zeros(2, 3, 40, 16)
    M = music([4, 20, 36]).repeat(2, 1, 1)
    changed = added(part, h, M, torch.tensor([True, False]))
    assert changed[0].abs().amax(-1).min() > 0 and not changed[1].any()
    assert torch.equal(changed[0, 0], changed[0, 1])


def test_loud_music_between_the_beats_is_not_in_it(part):
    h, M = torch.zeros(1, 1, 40, 16), music([4, 20, 36])
    louder = M.clone()
    louder[..., :34] = torch.randn(1, 40, 34)
    assert torch.equal(added(part, h, M), added(part, h, louder))


def test_single_dancers_are_told_the_same(part):
    M, h = music([4, 20, 36]), torch.zeros(1, 40, 16)
    assert torch.equal(added(part, h, M), added(part, h[:, None], M)[:, 0])
