"""Posture and its drift: on bodies made for it, choreographed and real dances, and broken ones."""

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
import torch

from dancediff.cli import main
from dancediff.data.choreographer import choreograph
from dancediff.data.cmu import cmu_jobs
from dancediff.metrics.corruption import freeze, mean_pose
from dancediff.metrics.drift import Drift, drift, in_range, mean_drift, ranges
from dancediff.metrics.posture import (
    POSTURE,
    ankle_distance,
    ankles_close,
    arms_wide,
    distinct_poses,
    from_pelvis,
    knee_bend,
    leaning,
    legs_crossed,
    legs_tangled,
    standing,
    stillness,
    turning,
)
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import SMPL24

REAL = Path(os.environ.get("DANCEDIFF_DATA", "../shared/data")) / "cmu"


def body(frames=60, **turns):
    """A body at rest in which some joints are turned: name=(x, y, z) degrees, or one a frame."""
    angles = torch.zeros(1, frames, 24, 3)
    for name, angle in turns.items():
        angles[:, :, SMPL24.index(name)] = torch.deg2rad(torch.as_tensor(angle).float())
    return Motion(axis_angle_to_matrix(angles), torch.zeros(1, frames, 3)).joints()


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.5, 20, 0.5), dancers=3, seed=2, seconds=20.0)[0]


def test_arms_are_wide_at_rest_and_not_at_the_sides():
    assert arms_wide(body()) == 1.0
    assert arms_wide(body(lshoulder=(0, 0, -80), rshoulder=(0, 0, 80))) == 0.0
    assert arms_wide(body(lshoulder=(0, 0, -80), rshoulder=(0, -60, 0))) == 0.0


def test_knee_bend_in_degrees():
    straight = knee_bend(body())
    assert straight < 12  # the bones at rest are not quite in line
    assert knee_bend(body(lknee=(90, 0, 0), rknee=(90, 0, 0))) == pytest.approx(90, abs=12)
    assert knee_bend(body(lknee=(90, 0, 0))) == pytest.approx((90 + straight) / 2, abs=6)


def test_turning_in_degrees_a_second():
    steady = [(0.0, 3.0 * k, 0.0) for k in range(60)]
    assert turning(body(root=steady)) == pytest.approx(90, rel=0.02)
    beyond = [(0.0, 3.0 * k + 170, 0.0) for k in range(60)]  # over the half turn and on
    assert turning(body(root=beyond)) == pytest.approx(90, rel=0.02)
    swings = [(0.0, 10 * math.sin(2 * math.pi * k / 5), 0.0) for k in range(60)]
    assert turning(body(root=swings)) < 5


def test_a_body_leans_when_it_tips_over_as_a_whole(dance):
    assert leaning(body(root=(20, 0, 0))) == 0.0
    for way in ((30, 0, 0), (-30, 0, 0), (0, 0, 30), (0, 50, 30), (160, 0, 0)):
        assert leaning(body(root=way)) == 1.0
    half = [(40.0 * (k >= 30), 0.0, 0.0) for k in range(60)]
    assert leaning(body(root=half)) == 0.5
    assert leaning(body(belly=(70, 0, 0), root=(-20, 0, 0))) == 0.0  # a bow, hips behind the feet
    assert leaning(dance.joints()) == 0.0
    tipped = dance.joints() @ axis_angle_to_matrix(torch.tensor([0.7, 0.0, 0.0])).T
    assert leaning(tipped) > 0.9


def test_closed_and_crossed_legs():
    closed = body(lhip=(0, 0, -3), rhip=(0, 0, 3))
    crossed = body(lhip=(0, 0, -25), rhip=(0, 0, 25))
    assert (ankles_close(body()), legs_crossed(body())) == (0.0, 0.0)
    assert (ankles_close(closed), legs_crossed(closed)) == (1.0, 0.0)
    assert (ankles_close(crossed), legs_crossed(crossed)) == (0.0, 1.0)
    turned = body(root=(0, 130, 0), lhip=(0, 0, -25), rhip=(0, 0, 25))
    assert legs_crossed(turned) == 1.0


def test_poses_are_counted_once_wherever_they_are_danced():
    switch = [(-90.0 * (k // 30 % 2), 0.0, 0.0) for k in range(150)]
    two = body(150, lhip=switch, rhip=switch)
    assert distinct_poses(two) == 2.0
    moved = two + torch.linspace(0, 5, 150)[None, :, None, None]
    turn = axis_angle_to_matrix(torch.tensor([0.0, 2.0, 0.0]))
    assert distinct_poses(moved @ turn.T) == 2.0
    torch.testing.assert_close(from_pelvis(two @ turn.T), from_pelvis(two), atol=1e-5, rtol=0)
    assert distinct_poses(torch.cat([two, body(150)], 1)) == 1.5  # the mean of its two windows


def test_frozen_and_averaged_dances_are_seen(dance):
    gen = np.random.default_rng(0)
    good, frozen, gliding = (
        d.joints() for d in (dance, freeze(dance, 1.0, gen), mean_pose(dance, 1.0, gen))
    )
    assert stillness(frozen) == 1.0 and stillness(good) < 0.3
    assert distinct_poses(frozen) == 1.0 and distinct_poses(gliding) == 1.0
    assert distinct_poses(good) > 1.3
    assert turning(frozen) == 0.0 and turning(good) > 2


def test_drift_finds_the_window_in_which_a_dance_breaks(dance):
    broken = dance.joints().clone()
    broken[:, 450:] = broken[:, 450:451]
    found = drift(broken)
    assert found.seconds.tolist() == [0, 5, 10, 15]
    assert found["stillness"][3] == 1.0 and found["stillness"][:3].max() < 0.5
    assert found["distinct poses"][3] == 1.0
    first, last = found.thirds("stillness")
    assert last > first + 0.3
    assert str(found).splitlines()[-1].split()[0] == "15-20"


def test_a_steady_dance_does_not_drift(dance):
    found = drift(dance.joints())
    first, last = found.thirds("knee bend")
    assert abs(last / first - 1) < 0.25


def test_tangled_legs_are_closed_or_crossed_ones(dance):
    joints = dance.joints()
    assert legs_tangled(body()) == 0
    closed = body(lhip=(0, 0, -4), rhip=(0, 0, 4))
    assert ankle_distance(closed) < ankle_distance(body()) - 0.05
    tangled = legs_tangled(joints)
    parts = ankles_close(joints), legs_crossed(joints)
    assert max(parts) <= tangled <= sum(parts)
    crossed = joints.clone()
    left, right = SMPL24.index("lankle"), SMPL24.index("rankle")
    crossed[..., [left, right], :] = joints[..., [right, left], :]
    assert legs_tangled(crossed) > 0.9
    assert ankle_distance(crossed) == pytest.approx(ankle_distance(joints))


def test_who_stands_is_found_and_who_moves_slowly_is_not(dance):
    rng = np.random.default_rng(0)
    assert standing(dance.joints()) < 0.1
    half = freeze(dance, 0.5, rng).joints()
    assert 0.4 < standing(half) < 0.6
    assert standing(mean_pose(dance, 1.0, rng).joints()) < 0.6  # a statue that glides
    slow = torch.zeros(1, 300, 24, 3)
    slow[..., 0] = torch.arange(300)[:, None] * 0.05 / 30  # 5 cm a second: still, and goes away
    assert stillness(slow) == 1
    assert standing(slow) == 0
    with pytest.raises(ValueError, match="90"):
        standing(torch.zeros(1, 80, 24, 3))


def test_windows_beyond_the_data_are_found(dance):
    many = [
        drift(choreograph(np.arange(0.5, 20, 0.5), dancers=3, seed=s, seconds=20.0)[0].joints())
        for s in range(10, 20)
    ]
    limits = ranges(many)
    own = np.mean([in_range(one, limits) for one in many], axis=0)
    assert (own >= 0.85).all()
    still = in_range(drift(freeze(dance, 1.0, np.random.default_rng(0)).joints()), limits)
    by_name = dict(zip(POSTURE, still, strict=True))
    assert by_name["stillness"] == by_name["standing"] == 0
    assert drift(dance.joints()).ends("turning")[0] == drift(dance.joints())["turning"][0]
    with pytest.raises(ValueError, match="drifts is empty"):
        ranges([])


def test_mean_drift_is_over_dances_not_windows():
    rows = np.arange(len(POSTURE))[:, None] * np.ones(3)
    mean = mean_drift([Drift(rows, np.arange(3) * 5.0), Drift(rows + 2, np.arange(3) * 5.0)])
    np.testing.assert_allclose(mean.values, rows + 1)
    with pytest.raises(ValueError, match="drifts is empty"):
        mean_drift([])
    with pytest.raises(KeyError, match="'grace' is not one of arms wide"):
        mean["grace"]
    with pytest.raises(ValueError, match="needs 150 or more"):
        drift(torch.zeros(1, 100, 24, 3))


@pytest.mark.skipif(not REAL.is_dir(), reason="no motion capture; set DANCEDIFF_DATA")
def test_people_bend_their_knees_and_turn():
    """Two real takes: the ranges of docs/ground_truth.md."""
    jobs = {job.name: job for job in cmu_jobs(REAL)}
    salsa, indian = (jobs[name].make().motion.joints() for name in ("salsa_01", "indian_04"))
    assert 40 < knee_bend(salsa) < 55 and 60 < knee_bend(indian) < 80
    assert turning(salsa) > 30 and arms_wide(salsa) < 0.05
    assert 0.01 < ankles_close(salsa) < 0.2


def test_the_command_prints_and_draws_the_drift(dance, tmp_path, capsys):
    dance.save(tmp_path / "dance.npz")
    main(["evaluate", str(tmp_path / "dance.npz"), "--drift", str(tmp_path / "p" / "drift.png")])
    printed = capsys.readouterr().out
    assert "mean over dances, window by window" in printed and "15-20" in printed
    assert "arms wide" in printed
    assert (tmp_path / "p" / "drift.png").read_bytes().startswith(b"\x89PNG")
    main(["evaluate", str(tmp_path / "dance.npz"), "--json", "--drift", str(tmp_path / "d.png")])
    facts = json.loads(capsys.readouterr().out)
    assert len(facts["drift"]["knee bend"]) == 4
    dance.frames(0, 60).save(tmp_path / "short.npz")  # too short for a window: left out
    main(["evaluate", str(tmp_path), "--drift", str(tmp_path / "d.png")])
    assert "15-20" in capsys.readouterr().out


def test_the_command_tells_the_table_of_dances_too_short_for_drift(dance, tmp_path, capsys):
    dance.frames(0, 60).save(tmp_path / "short.npz")
    args = ["evaluate", str(tmp_path / "short.npz"), "--drift", str(tmp_path / "d.png")]
    assert main(args) == 1
    told = capsys.readouterr()
    assert "FSR" in told.out and "window by window" not in told.out
    assert "no dance of 5 s or more" in told.err and not (tmp_path / "d.png").exists()


def test_the_command_measures_a_dance_once(dance, tmp_path, capsys, monkeypatch):
    dance.save(tmp_path / "dance.npz")
    kept = ["--keep", str(tmp_path / "kept"), "--workers", "1", "--json"]
    args = ["evaluate", str(tmp_path / "dance.npz"), "--drift", str(tmp_path / "d.png"), *kept]
    assert main(args) == 0
    first = json.loads(capsys.readouterr().out)
    monkeypatch.setattr("dancediff.metrics.measure_all.measure", None)
    monkeypatch.setattr("dancediff.metrics.dances.read_dance", None)
    assert main(args) == 0
    again = json.loads(capsys.readouterr().out)
    loaded = Motion.load(tmp_path / "dance.npz")
    assert first["drift"] == again["drift"] == drift(loaded.joints()).facts()


def test_drift_compares_the_first_third_with_the_last():
    one = Drift(np.tile(np.arange(6.0) ** 2, (len(POSTURE), 1)), np.arange(6))
    assert one.thirds("turning") == (0.5, 20.5)
    assert one.ends("turning") == (0.0, 25.0)
