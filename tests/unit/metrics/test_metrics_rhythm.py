import math

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter1d

from dancediff.data.choreographer import choreograph
from dancediff.metrics.corruption import jitter, shift_beats
from dancediff.metrics.rhythm import beat_alignment, closeness
from dancediff.motion.beats import motion_beats
from dancediff.music.song import Music

BEATS = np.arange(0.3, 8, 0.5)
SONG = Music(np.zeros(9), 9)


@pytest.fixture(scope="module")
def joints():
    return choreograph(BEATS, dancers=3, seed=0, seconds=8)[0].joints()


def minima(speed, order=1):
    """Frames whose value lies under each neighbour up to ``order`` frames away, by a loop."""
    found = []
    for i in range(len(speed)):
        near = [
            speed[min(max(i + k, 0), len(speed) - 1)] for k in range(-order, order + 1) if k != 0
        ]
        if all(speed[i] < other for other in near):
            found.append(i)
    return found


def score(asked, answers, sigma):
    total = 0.0
    for a in asked:
        total += math.exp(-(min(abs(a - b) for b in answers) ** 2) / (2 * sigma**2))
    return total / len(asked)


def slow(joints, beats, fps, direction, compat):
    """The formula of each form, one dancer and one joint at a time."""
    scores = []
    for dancer in joints.double().numpy():
        f = len(dancer)
        forward = np.array(
            [[math.dist(dancer[i], dancer[i + 1]) for i in range(f - 1)] for dancer in
             dancer.transpose(1, 0, 2)]
        )  # fmt: skip
        if compat == "lodge":
            m = minima(gaussian_filter1d(forward.mean(0), 5))
            sigma, limit = 3 / fps, math.inf
        elif compat:
            m = minima(forward.sum(0), order=round(fps / 6))
            sigma, limit = (2.12 if fps == 30 else 2.998) / fps, math.inf
        else:
            central = np.array(
                [
                    np.mean(
                        [
                            math.dist(dancer[min(i + 1, f - 1), j], dancer[max(i - 1, 0), j])
                            / (min(i + 1, f - 1) - max(i - 1, 0))
                            for j in range(dancer.shape[1])
                        ]
                    )
                    for i in range(f)
                ]
            )
            smooth = gaussian_filter1d(central, 0.05 * fps, mode="nearest")
            left, here, right = smooth[:-2], smooth[1:-1], smooth[2:]
            m = [i + 1 for i in range(f - 2) if left[i] > here[i] <= right[i]]
            sigma, limit = 0.1, f / fps
        music = [b for b in beats if b < limit]
        m = [i / fps for i in m]
        scores.append(score(music, m, sigma) if direction == "music" else score(m, music, sigma))
    return sum(scores) / len(scores)


@pytest.mark.parametrize("fps", [30.0, 60.0])
@pytest.mark.parametrize(
    ("direction", "compat"),
    [("music", None), ("motion", None), ("music", "lodge"), ("motion", "aist"), ("motion", "gcd")],
)
def test_equals_the_formula_in_a_loop(joints, fps, direction, compat):
    noisy = joints[:2, :120] + 0.01 * torch.randn(2, 120, 24, 3)
    beats = np.array([0.31, 0.9, 1.4, 1.9, 2.77, 6.0])
    ours = beat_alignment(noisy, beats, fps=fps, direction=direction, compat=compat)
    assert ours == pytest.approx(slow(noisy, beats, fps, direction, compat), abs=1e-5)
    assert 0.05 < ours < 0.999


def test_motion_beats_as_music_beats_give_one(joints):
    m = motion_beats(joints[0].double()) / 30
    for direction in ("music", "motion"):
        assert beat_alignment(joints[0], m, direction=direction) == pytest.approx(1, abs=1e-12)
    assert beat_alignment(joints[1], m) < 1


def test_one_sigma_off_scores_as_the_bell_says():
    path = torch.cos(torch.arange(60) / 60 * 4 * torch.pi)
    dance = path[:, None, None] * torch.ones(60, 24, 3)
    off = beat_alignment(dance, [0.6, 1.1, 1.6])
    assert off == pytest.approx(math.exp(-0.5), abs=1e-9)


def test_the_two_directions_ask_different_questions():
    path = torch.cos(torch.arange(60) / 60 * 4 * torch.pi)  # beats at 0.5, 1.0 and 1.5 s
    dance = path[:, None, None] * torch.ones(60, 24, 3)
    missed = beat_alignment(dance, [0.5, 0.75, 1.0, 1.25, 1.5])
    assert missed < 0.7
    assert beat_alignment(dance, [0.5, 0.75, 1.0, 1.25, 1.5], direction="motion") == 1
    assert beat_alignment(dance, [0.5]) == 1
    assert beat_alignment(dance, [0.5], direction="motion") < 0.4


def test_the_group_is_the_mean_of_its_dancers(joints):
    alone = [beat_alignment(dancer, BEATS) for dancer in joints]
    assert beat_alignment(joints, BEATS) == pytest.approx(np.mean(alone), abs=1e-12)
    assert np.ptp(alone) > 0


def test_a_dancer_who_stands_still_scores_zero():
    for direction in ("music", "motion"):
        assert beat_alignment(torch.ones(1, 90, 24, 3), BEATS, direction=direction) == 0
        assert beat_alignment(torch.ones(90, 24, 3), BEATS, direction="motion", compat="aist") == 0


def test_good_dances_score_high_and_foreign_beats_low(joints):
    foreign = shift_beats(BEATS, 1.0, np.random.default_rng(0))
    for direction in ("music", "motion"):
        assert beat_alignment(joints, BEATS, direction=direction) > 0.85
        assert beat_alignment(joints, foreign, direction=direction) < 0.65


def test_trembling_fools_bas_more_than_mmc():
    scores = []
    for seed in range(5):
        dance = choreograph(BEATS, dancers=2, seed=seed, seconds=8)[0]
        joints = jitter(dance, 1.0, np.random.default_rng(seed)).joints()
        scores.append([beat_alignment(joints, BEATS, direction=d) for d in ("music", "motion")])
    bas, mmc = np.mean(scores, axis=0)
    assert bas > 0.6 and mmc < 0.55  # chance is 0.1 sqrt(2 pi) / 0.5 = 0.5


def test_frame_rate_hardly_matters():
    time = torch.arange(240, dtype=torch.float64) / 60
    dance = torch.cos(2 * torch.pi * time)[:, None, None] * torch.ones(240, 24, 3)
    beats = [0.55, 1.1, 1.5, 2.2]
    ours = [beat_alignment(dance[::k], beats, fps=60 / k) for k in (1, 2)]
    assert ours[0] == pytest.approx(ours[1], abs=1e-3)


@pytest.mark.parametrize("compat", [None, "lodge"])
def test_stage_rotation_and_translation_change_nothing(joints, compat):
    c, s = math.cos(1.1), math.sin(1.1)
    turn = torch.tensor([[c, 0, s], [0, 1, 0], [-s, 0, c]], dtype=torch.float64)
    moved = joints.double() @ turn.T + torch.tensor([3.0, 0, -2])
    ours = [beat_alignment(x, BEATS, compat=compat) for x in (joints, moved)]
    assert ours[0] == pytest.approx(ours[1], abs=1e-6)


def test_only_beats_within_the_clip_count(joints):
    early = BEATS[BEATS < 4]
    assert beat_alignment(joints[:, :120], BEATS) == beat_alignment(joints[:, :120], early)
    lodge = [beat_alignment(joints[:, :120], b, compat="lodge") for b in (BEATS, early)]
    assert lodge[0] < lodge[1]


def test_bad_input_is_named(joints):
    nan = joints.clone()
    nan[0, 3, 4, 1] = float("nan")
    for words, call in [
        ("2 frames", lambda: beat_alignment(joints[:, :2], BEATS)),
        ("NaN", lambda: beat_alignment(nan, BEATS)),
        (r"shape \(3, 240, 5, 3\)", lambda: beat_alignment(joints[:, :, :5], BEATS)),
        ("beats has 0 times", lambda: beat_alignment(joints, [])),
        (r"beats is a Music; .* song.beats\(\)", lambda: beat_alignment(joints, SONG)),
        ("none of them within", lambda: beat_alignment(joints, [99.0])),
        ("finite", lambda: beat_alignment(joints, [1.0, float("nan")])),
        ("fps", lambda: beat_alignment(joints, BEATS, fps=0)),
        ("direction='both'", lambda: beat_alignment(joints, BEATS, direction="both")),
        ("'lodge', 'aist', 'gcd'", lambda: beat_alignment(joints, BEATS, compat="edge")),
        ("direction='motion' only", lambda: beat_alignment(joints, BEATS, compat="gcd")),
    ]:
        with pytest.raises(ValueError, match=words):
            call()


def test_the_nearest_beat_is_found_in_any_order():
    rng = np.random.default_rng(0)
    times, others = 10 * rng.random(50), 10 * rng.random(40)
    for some in (others, others[:1]):
        nearest = np.abs(times[:, None] - some).min(1)
        assert closeness(times, some, 0.1) == pytest.approx(np.exp(-(nearest**2) / 0.02).mean())
