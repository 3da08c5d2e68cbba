import math

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.data.cmu import cmu_jobs
from dancediff.metrics.corruption import drag_feet, freeze
from dancediff.metrics.physical import below_floor, fsr, pfc

FEET = ((7, 10), (8, 11))  # ankle and toe, left and right


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.3, 6, 0.5), dancers=2, seed=1, seconds=6)[0]


@pytest.fixture(scope="module")
def joints(dance):
    return drag_feet(dance, 0.6, np.random.default_rng(3)).joints().double()


def floor_step(p, i, j):
    """Signed x and z step of joint j from frame i to the next."""
    return p[i + 1, j, 0] - p[i, j, 0], p[i + 1, j, 2] - p[i, j, 2]


def slow_pfc(joints, fps, per_frame):
    scores = []
    for p in joints.numpy():
        pushes, feet = [], []
        for i in range(len(p) - 2):
            a = [(p[i + 2, 0, k] - 2 * p[i + 1, 0, k] + p[i, 0, k]) * fps**2 for k in range(3)]
            pushes.append(math.hypot(a[0], max(a[1], 0), a[2]))
            travel = [min(math.hypot(*floor_step(p, i + 1, j)) for j in foot) for foot in FEET]
            scale = 1 if per_frame else fps / 30
            feet.append(travel[0] * travel[1] * scale**2)
        largest = max(pushes)
        scores.append(np.mean([a / largest * u for a, u in zip(pushes, feet, strict=True)]))
    return 1e4 * np.mean(scores)


def slow_fsr(joints, fps, threshold):
    slides = down = 0
    for p in joints.numpy():
        for ankle, toe in FEET:
            for i in range(len(p) - 1):
                if all(p[k, ankle, 1] < 0.12 and p[k, toe, 1] < 0.05 for k in (i, i + 1)):
                    down += 1
                    v = max(math.hypot(*floor_step(p, i, j)) * fps for j in (ankle, toe))
                    slides += v > threshold
    return slides / down


def slow_fsr_lodge(joints, fps, threshold):
    ratios = []
    for ankle, toe in FEET:
        for p in joints.numpy():
            left, right = p[0, 10, 1], p[0, 11, 1]
            floor = (left + right) / 2 if abs(left - right) < 0.02 else min(left, right)
            slides = down = 0
            for i in range(len(p)):
                if p[i, ankle, 1] - floor <= 0.08 and p[i, toe, 1] - floor <= 0.05:
                    down += 1
                    if i + 1 < len(p):
                        v = max(abs(sum(floor_step(p, i, j)) / 2) * fps for j in (ankle, toe))
                        slides += v > threshold
            ratios.append(slides / down)
    return sum(ratios) / len(ratios)


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_pfc_equals_the_formula_in_a_loop(joints, fps):
    assert pfc(joints, fps=fps) == pytest.approx(slow_pfc(joints, fps, False), rel=1e-5)
    edge = pfc(joints, fps=fps, compat="edge")
    assert edge == pytest.approx(slow_pfc(joints, fps, True), rel=1e-5)
    assert edge > 0.1


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_fsr_equals_the_formula_in_a_loop(joints, fps):
    ours = fsr(joints, fps=fps, threshold=0.25)
    assert ours == pytest.approx(slow_fsr(joints, fps, 0.25), abs=1e-5)
    lodge = fsr(joints, fps=fps, compat="lodge")
    assert lodge == pytest.approx(slow_fsr_lodge(joints, fps, 0.3), abs=1e-5)
    assert 0.1 < lodge < ours < 0.95


def test_a_dancer_who_never_moves_has_pfc_zero_and_no_number_in_edges_form(dance):
    still = freeze(dance, 1.0, np.random.default_rng(0)).joints()
    assert pfc(still) == 0
    assert math.isnan(pfc(still, compat="edge"))


def test_one_still_foot_or_a_falling_root_costs_nothing():
    p = torch.rand(1, 60, 24, 3, dtype=torch.float64)
    p[:, :, 10] = p[:, :1, 10]  # the left toe stands: u_left = 0
    assert pfc(p) == 0
    p = torch.rand(1, 60, 24, 3, dtype=torch.float64)
    p[:, :, 0] = 0
    p[:, :, 0, 1] = -4.9 * (torch.arange(60) / 30) ** 2
    assert pfc(p) == pytest.approx(0, abs=1e-9)
    p[:, :, 0, 1] *= -1
    assert pfc(p) > 1


def test_one_violent_frame_lowers_pfc(joints):
    spiked = joints.clone()
    spiked[:, 90, 0, 0] += 0.3  # the root only: the feet travel as before
    assert pfc(spiked) < 0.3 * pfc(joints)


def test_pfc_of_a_known_slide():
    """Both feet travel 3 cm in 1/30 s while the root speeds up evenly: 9 cm^2, at any fps."""
    for fps in (30, 60):
        t = torch.arange(fps, dtype=torch.float64) / fps
        p = torch.zeros(fps, 24, 3, dtype=torch.float64)
        p[:, 0, 0] = t**2
        p[:, (7, 8, 10, 11), 2] = 0.9 * t[:, None]
        assert pfc(p, fps=fps) == pytest.approx(9, rel=1e-6)
        assert pfc(p, fps=fps, compat="edge") == pytest.approx(9 * (30 / fps) ** 2, rel=1e-6)


def test_fsr_of_a_known_slide():
    p = torch.zeros(31, 24, 3, dtype=torch.float64)
    p[10:20, 7, 0] = 0.02 * torch.arange(1, 11)  # 0.6 m/s for ten frames, left foot only
    p[20:, 7, 0] = 0.2
    assert fsr(p) == pytest.approx(10 / 60)
    assert fsr(p, threshold=0.7) == 0
    p[:, 10, 1] = 0.06  # the left toe is in the air: only the right foot counts
    assert fsr(p) == 0


def test_lodges_form_does_not_see_a_slide_along_the_diagonal():
    p = torch.zeros(31, 24, 3, dtype=torch.float64)
    p[..., 0] = torch.arange(31)[:, None] / 30
    p[..., 2] = -p[..., 0]
    assert fsr(p) == 1
    assert fsr(p, compat="lodge") == 0


def test_good_dances_score_low_and_dragged_ones_high(dance):
    dragged = drag_feet(dance, 1.0, np.random.default_rng(0)).joints()
    good = dance.joints()
    assert fsr(good) < 0.04 and fsr(dragged) > 0.5
    assert pfc(good) < 0.7 and pfc(dragged) > 1.5


@pytest.mark.parametrize("metric", [pfc, fsr])
def test_stage_rotation_and_translation_change_nothing(metric, joints):
    c, s = math.cos(0.7), math.sin(0.7)
    turn = torch.tensor([[c, 0, s], [0, 1, 0], [-s, 0, c]], dtype=torch.float64)
    moved = joints @ turn.T + torch.tensor([3.0, 0, -2], dtype=torch.float64)
    assert metric(moved) == pytest.approx(metric(joints), rel=1e-5)
    assert metric(joints) > 0.1


@pytest.mark.parametrize("metric", [pfc, fsr])
def test_a_solo_and_a_group_of_copies_score_the_same(metric, joints):
    copies = torch.stack([joints[0]] * 3)
    assert metric(copies) == pytest.approx(metric(joints[0]), rel=1e-9)


def test_bad_input_is_named(joints, dance):
    nan = joints.clone()
    nan[0, 3, 4, 1] = float("nan")
    for words, call in [
        ("2 frames; this metric needs 3", lambda: pfc(joints[:, :2])),
        ("1 frames; this metric needs 2", lambda: fsr(joints[:, :1])),
        ("NaN", lambda: pfc(nan)),
        ("NaN", lambda: fsr(nan)),
        (r"shape \(2, 180, 24\)", lambda: pfc(joints[..., 0])),
        (r"joints is a Motion; .* motion.joints\(\)", lambda: pfc(dance)),
        ("joints is a NoneType", lambda: fsr(None)),
        ("use None or 'edge'", lambda: pfc(joints, compat="lodge")),
        ("use None or 'lodge'", lambda: fsr(joints, compat="aist")),
        ("threshold=0", lambda: fsr(joints, threshold=0)),
        ("fps=-1", lambda: fsr(joints, fps=-1)),
        ("never on the floor", lambda: fsr(joints + 1)),
    ]:
        with pytest.raises(ValueError, match=words):
            call()


def test_real_takes_lie_between_planned_and_dragged(real_data):
    folder = real_data / "cmu"
    if not (folder / "manifest.json").is_file():
        pytest.skip(f"no cmu/manifest.json in {real_data}")
    take = next(job for job in cmu_jobs(folder) if job.name == "salsa_01").make()
    dragged = drag_feet(take.motion, 1.0, np.random.default_rng(0)).joints()
    assert 0.02 < fsr(take.motion.joints()) < 0.45 < 0.7 < fsr(dragged)
    assert 0.1 < pfc(take.motion.joints()) < 1 < pfc(dragged)


def test_a_dance_is_as_far_below_the_floor_as_it_sinks(dance):
    joints = dance.joints().double()
    assert below_floor(joints) == 0
    lowest = joints[..., 1].amin(-1)  # (n, f)
    one = joints.clone()
    one[1, :, :, 1] -= 0.3 + lowest[1, :, None]  # of two dancers one, 30 cm deep in every frame
    assert below_floor(one) == pytest.approx(15)
    one[1, :45, :, 1] += 5  # and now flying for a quarter of the time, which makes up for nothing
    assert below_floor(one) == pytest.approx(15 * (1 - 45 / joints.shape[1]))
    assert below_floor(joints + torch.tensor([3.0, 0, -2.0])) == 0
