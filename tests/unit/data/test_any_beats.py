"""The choreographer dances to any beats: none, late, with gaps, changing, in three, quick, slow."""

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import GENRES, choreograph
from dancediff.data.choreographer.breath import BREATHS, WALKS
from dancediff.data.choreographer.formations import min_distance
from dancediff.data.choreographer.grid import SLOW, make_grid
from dancediff.data.choreographer.moves import in_three
from dancediff.data.choreographer.poses import ARM_POSES
from dancediff.motion.beats import motion_beats

SECONDS = 24
BEATS = {
    "none": np.array([]),
    "one": np.array([3.0]),
    "late": np.arange(7, 25, 0.55),
    "break": np.concatenate([np.arange(0.3, 8, 0.5), np.arange(14.1, 25, 0.5)]),
    "early end": np.arange(0.3, 13, 0.5),
    "sudden": np.concatenate([np.arange(0.2, 11, 0.62), np.arange(11.4, 25, 0.45)]),
    "rubato": np.cumsum(0.62 + 0.18 * np.sin(0.6 * np.arange(42))),
    "half": np.arange(0.4, 25, 1.3),
    "double": np.arange(0.4, 25, 0.27),
}


def dances(beats, **options):
    for seed, genre in enumerate(GENRES):
        dance, truth = choreograph(
            beats, dancers=1 + seed % 5, seed=seed, seconds=SECONDS, genre=genre, **options
        )
        yield dance, truth, dance.joints()


def speed(joints):
    """Mean joint speed, metres a second, of each frame."""
    return 30 * joints.diff(dim=1).norm(dim=-1).mean((0, 2))


@pytest.mark.parametrize("name", BEATS)
def test_every_song_is_danced_without_rushing_or_freezing(name):
    for dance, truth, joints in dances(BEATS[name]):
        assert dance.num_frames == SECONDS * 30
        windows = speed(joints).unfold(0, 150, 15).mean(1)
        assert 0.12 < windows.min() and windows.max() < 1.0
        assert dance.root.diff(dim=1).norm(dim=-1).max() < 0.12
        assert min_distance(dance.root[..., (0, 2)].numpy()) > 0.45
        assert joints[..., 1].min() > -0.01
        for start, stop in truth.breaths:
            inside = speed(joints)[start + 15 : stop - 15]
            if len(inside) > 45:
                assert 0.13 < inside.mean() < 0.4


@pytest.mark.parametrize("name", ["late", "break"])
def test_where_the_beat_comes_back_they_start_on_it(name):
    found, slower = [], []
    for _, truth, joints in dances(BEATS[name]):
        start, stop = truth.breaths[0]
        inner = truth.beats[(truth.beats >= stop) & (truth.beats < joints.shape[1] - 10)]
        assert inner[0] == pytest.approx(stop, abs=1)
        for one in joints:
            hits = [np.abs(motion_beats(one) - beat).min() <= 2 for beat in inner[:6]]
            found.append(np.mean(hits))
        slower.append(speed(joints)[start + 15 : stop - 15].mean() / speed(joints)[stop:].mean())
    assert np.mean(found) > 0.85
    assert max(slower) < 0.85 and np.mean(slower) < 0.6


def test_gaps_are_filled_with_slow_counts_that_meet_the_beat():
    grid = make_grid(BEATS["break"], SECONDS * 30)
    ((start, stop),) = grid.gaps
    inside = np.diff(grid.anchors[start - 1 - grid.first : stop + 1 - grid.first])
    assert np.ptp(inside) < 1e-9 and abs(inside[0] - SLOW) < 0.25
    assert np.isin(BEATS["break"], grid.anchors).all()
    assert grid.calm[grid.frame(start + 1)] > 0.99 and grid.calm[:200].max() < 0.01
    assert (np.diff(grid.beat) > 0).all()


def test_a_song_of_even_beats_is_laid_out_as_before():
    """Counts are the beats, and frames lie evenly between them."""
    beats = np.arange(0.2, 24, 0.5)
    grid = make_grid(beats, SECONDS * 30)
    assert grid.gaps == () and not grid.calm.any()
    assert np.array_equal(grid.anchors, beats)
    time = np.arange(SECONDS * 30) / 30
    assert grid.beat == pytest.approx((time - 0.2) / 0.5 + 2, abs=1e-9)


@pytest.mark.parametrize(("meter", "spb", "phrase"), [(3, 0.5, 6), (6, 0.45, 6), (6, 0.25, 8)])
def test_phrases_fit_the_bars(meter, spb, phrase):
    beats = np.arange(0.4, 25, spb)
    grid = make_grid(beats, SECONDS * 30, meter)
    assert grid.phrase == phrase
    count = 3 * spb if phrase == 8 else spb
    assert np.median(np.diff(grid.anchors)) == pytest.approx(count)
    for _, truth, joints in dances(beats, meter=meter):
        assert 0.12 < speed(joints).unfold(0, 150, 15).mean(1).min()
        for start, *_ in truth.sections[1:]:  # sections begin with a bar
            bars = np.abs((start / 30 - 0.4) / (spb * meter) - np.arange(40)).min()
            assert bars * spb * meter < 0.05


def test_moves_in_three_step_with_the_other_foot_in_the_second_bar():
    for genre in map(in_three, GENRES.values()):
        assert genre.phrase == 6 and len(genre.moves) >= 5
        for move in (*genre.moves, *genre.travel, genre.rest):
            assert move.channels[0].shape[0] == 6
            assert all(key[0] < 6 for arm in move.arms for key in arm)
            assert all(fall.count < 6 for fall in move.falls)
        for move in genre.travel:
            on_beat = [fall.foot for fall in move.falls if fall.count == int(fall.count)]
            assert on_beat[::3][:2] == ["R", "L"]


def test_breathing_is_written_with_known_poses():
    for move in (*BREATHS, *WALKS):
        assert move.falls and move.channels[0].shape[0] == 8
        assert all(key[1] in ARM_POSES for arm in move.arms for key in arm)


def test_the_same_seed_breathes_alike():
    a, b = (choreograph([], dancers=2, seed=3, seconds=8)[0] for _ in range(2))
    assert torch.equal(a.pose, b.pose)


def test_missing_length_and_a_wrong_meter_are_named():
    for seconds in (-1, 0.034, float("nan")):
        with pytest.raises(ValueError, match=f"seconds={seconds}.* two frames"):
            choreograph([0.5, 1.0], seconds=seconds)
    with pytest.raises(ValueError, match="seconds=None"):
        choreograph([])
    with pytest.raises(ValueError, match="meter=0"):
        choreograph(BEATS["late"], meter=0)
