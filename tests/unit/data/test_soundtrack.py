"""Music for silent motion: its beats are those of the dance."""

import numpy as np
import pytest
import torch

from beat_score import beat_f_score
from dancediff.data import soundtrack as module
from dancediff.data.soundtrack import rest_curve, soundtrack, tempo_map, with_soundtrack
from dancediff.data.take import DanceTake
from dancediff.motion.motion import Motion
from dancediff.music.features import beat_times
from dancediff.music.synth import synth_on_beats


def swing(beats, frames, n=1):
    """Dancers who swing to and fro and turn round on every beat."""
    phase = np.interp(np.arange(frames) / 30, beats, np.arange(len(beats)))
    root = torch.zeros(n, frames, 3)
    root[..., 0] = torch.from_numpy(0.5 * np.cos(np.pi * phase)).float()
    return Motion(torch.eye(3).expand(n, frames, 24, 3, 3), root)


def accelerando(first=0.75, last=0.45, count=40):
    return 0.4 + np.concatenate([[0], np.cumsum(np.geomspace(first, last, count - 1))])


@pytest.mark.parametrize("beats", [accelerando(), accelerando(0.42, 0.7), np.arange(0.3, 20, 0.55)])
def test_beats_follow_a_tempo_that_changes(beats):
    motion = swing(beats, int(beats[-1] * 30))
    found = tempo_map(rest_curve(motion.joints()))
    truth = beats[1:-1]  # the ends are no turning points
    assert beat_f_score(found, truth, tolerance=2 / 30) > 0.93
    even = np.arange(beats[0], beats[-1], np.diff(beats).mean())
    if np.ptp(np.diff(beats)) > 0.1:  # what a constant grid would give
        assert beat_f_score(even, truth, tolerance=2 / 30) < 0.6


def test_tempo_changes_gradually_and_stays_danceable():
    rest = np.random.default_rng(0).random(600) ** 6  # rests anywhere
    gaps = np.diff(tempo_map(rest))
    assert gaps.min() > 0.3 and gaps.max() < 0.85
    assert np.abs(np.diff(gaps)).max() < 0.1


@pytest.mark.parametrize("seed", range(4))
def test_the_row_of_beats_is_the_best_one(seed):
    """Against trying every row, on a short piece."""
    rest = np.random.default_rng(seed).random(56)
    gain, gaps = rest - module._MISSED, module.INTERVALS
    prior = 0.3 * np.log2(gaps / 16.5) ** 2
    best = [-np.inf, []]

    def go_on(row, gap, worth):
        if row[-1] >= 56 - gaps[-1] and worth > best[0]:
            best[:] = worth, row
        for new in range(max(gap - 2, gaps[0]), min(gap + 2, gaps[-1]) + 1):
            if (at := row[-1] + new) < 56:
                more = gain[at] - prior[new - gaps[0]] - module._CHANGE * (new - gap) ** 2
                go_on([*row, at], new, worth + more)

    for gap in gaps:  # the interval before the first beat counts as well
        for first in range(gap + gaps[-1]):
            go_on([first], int(gap), gain[first] - prior[gap - gaps[0]])
    assert module._best_row(rest).tolist() == best[1] and len(best[1]) > 2


def test_a_still_dance_gets_music_too():
    M, beats = soundtrack(swing([0, 100], 90), songs=1)
    assert M.shape == (1, 90, 35) and torch.isfinite(M).all() and len(beats) >= 3


def test_short_and_silly_arguments():
    with pytest.raises(ValueError, match="59 frames"):
        soundtrack(swing([0, 100], 59))
    with pytest.raises(ValueError, match="songs=0"):
        soundtrack(swing([0, 100], 90), songs=0)


def test_songs_differ_in_sound_but_not_in_beats():
    motion = swing(accelerando(), 300)
    M, beats = soundtrack(motion, seed=4, songs=3)
    assert M.shape == (3, 300, 35)
    for k in range(3):  # the column is late, as that of any song; what is read from it is not
        assert np.allclose(beat_times(M[k]), beats, atol=0.5 / 30 + 1e-6)
    timbre = M[:, :, 1:21].mean(1)
    assert torch.cdist(timbre, timbre)[0, 1:].min() > 10  # MFCC, the spread within a corpus is ~50
    again, _ = soundtrack(motion, seed=4, songs=3)
    assert torch.equal(M, again) and not torch.equal(M, soundtrack(motion, seed=5, songs=3)[0])


def test_the_take_says_what_its_music_is():
    motion = swing(accelerando(), 300, n=2)
    take = DanceTake("a", motion, "real", "none", "s", "l", "train", "a")
    told = with_soundtrack(take, songs=2)
    assert told.music == "beat-aligned synthetic" and told.M_other.shape == (1, 300, 35)
    assert told.notes["beats_met"] > 0.9 and take.M is None


def test_onsets_are_where_the_beats_are_put():
    """Of a song on an uneven grid: sound sets in on its beats, not on an even grid."""
    grid = accelerando(count=30)
    song, truth = synth_on_beats(grid, 5, seconds=12)
    onset = song.features()[:, 0].numpy()
    inside = truth.beats[(truth.beats > 0.5) & (truth.beats < 11.5)]

    def loud(times):
        frames = np.round(times * 30).astype(int)
        return np.mean([onset[f - 1 : f + 2].max() for f in frames])

    between = inside[:-1] + 0.37 * np.diff(inside)
    assert loud(inside) > 1.5 * loud(between)
    assert np.allclose(truth.beats[1:4], grid[:3] if truth.beats[0] < 0.3 else grid[1:4], atol=0.8)
    assert set(np.round(grid[grid < 12], 6)) <= set(np.round(truth.beats, 6))


@pytest.mark.parametrize(
    ("beats", "words"),
    [
        ([1.0], "at least 2"),
        ([-1.0, 0.0], "from 0"),
        ([0, 0.1], "0.10 to"),
        ([0, 5], "5.00 s apart"),
    ],
)
def test_impossible_grids_are_named(beats, words):
    with pytest.raises(ValueError, match=words):
        synth_on_beats(beats, 0, seconds=5)
    with pytest.raises(ValueError, match="seconds=0"):
        synth_on_beats([1, 2], 0, seconds=0)
