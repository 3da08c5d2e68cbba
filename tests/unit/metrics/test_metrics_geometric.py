import math

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.metrics import corruption
from dancediff.metrics.geometric import TESTS, geometric_features
from dancediff.metrics.kinetic import lodge_positions
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import SMPL24

HL, SW, HW = 0.25684, 0.39085, 0.11925
# The 32 tests of the notes, written out a second time: kind, joints, threshold.
LIST = [
    ("nmove", "neck rhip lhip rwrist", 1.8 * HL),
    ("nmove", "neck lhip rhip lwrist", 1.8 * HL),
    *[("nplane", f"chest neck neck {s}wrist", 0.2 * HL) for s in "rl"],
    *[("move", f"belly chest chest {s}wrist", 1.8 * HL) for s in "rl"],
    *[("angle", f"{s}elbow {s}shoulder {s}elbow {s}wrist", (0, 110)) for s in "rl"],
    ("nplane", "lshoulder rshoulder lwrist rwrist", 2.5 * SW),
    ("move", "lwrist rwrist rwrist lwrist", 1.4 * HL),
    ("move", "rwrist root lwrist root", 1.4 * HL),
    ("move", "lwrist root rwrist root", 1.4 * HL),
    *[("fast", f"{s}wrist", 2.5 * HL) for s in "rl"],
    ("plane", "root lhip ltoe rankle", 0.38 * HL),
    ("plane", "root rhip rtoe lankle", 0.38 * HL),
    *[("nplane", f"zero y ymin {s}ankle", 1.2 * HL) for s in "rl"],
    ("nplane", "lhip rhip lankle rankle", 2.1 * HW),
    *[("angle", f"{s}knee {s}hip {s}knee {s}ankle", (0, 110)) for s in "rl"],
    *[("fast", f"{s}ankle", 2.5 * HL) for s in "rl"],
    *[("angle", f"neck root {s}shoulder {s}elbow", (25, 180)) for s in "rl"],
    *[("angle", f"neck root {s}hip {s}knee", (50, 180)) for s in "rl"],
    ("plane", "rankle neck lankle root", 0.5 * HL),
    ("angle", "neck root zero y", (70, 110)),
    *[("nplane", f"zero -y ymin {s}wrist", -1.2 * HL) for s in "rl"],
    ("fast", "root", 2.3 * HL),
]

NAMES = tuple(name for name, *_ in TESTS)


def point(frame, name):
    fixed = {"zero": (0, 0, 0), "y": (0, 1, 0), "-y": (0, -1, 0), "ymin": (0, frame[:, 1].min(), 0)}
    return np.array(fixed[name]) if name in fixed else frame[SMPL24.names.index(name)]


def unit(v):
    return v / math.sqrt(v @ v)


def slow_test(kind, names, limit, now, then, fps, three):
    p = [point(now, name) for name in names.split()]
    q = [point(then, name) for name in names.split()]
    if kind == "nplane":
        return (p[3] - p[2]) @ unit(p[1] - p[0]) > limit
    if kind == "plane":
        return (p[3] - p[0]) @ unit(np.cross(p[2] - p[0], p[1] - p[0])) > limit
    if kind == "nmove":
        v = ((p[3] - p[0]) - (q[3] - q[0])) * fps
        return v @ unit(np.cross(p[2] - p[0], p[1] - p[0])) > limit
    if kind == "move":
        moved = (p[2] - p[0]) - (q[2] - q[0]) if three else (p[3] - p[2]) - (q[3] - q[2])
        return moved @ unit(p[1] - p[0]) * fps > limit
    if kind == "angle":
        degrees = math.degrees(math.acos(np.clip(unit(p[1] - p[0]) @ unit(p[3] - p[2]), -1, 1)))
        return limit[0] < degrees < limit[1]
    return math.sqrt(((p[0] - q[0]) ** 2).sum()) * fps > limit  # fast


def slow_features(joints, fps, three=False):
    rows = []
    for x in joints.numpy():
        frames = range(1, len(x))
        rows.append([
            np.mean([slow_test(*test, x[t], x[t - 1], fps, three) for t in frames]) for test in LIST
        ])  # fmt: skip
    return np.array(rows)


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.3, 4, 0.5), dancers=3, seed=1, seconds=4)[0]


@pytest.fixture(scope="module")
def joints(dance):
    # shaken a little, so that more of the tests hold somewhere
    noise = torch.randn(3, 120, 24, 3, generator=torch.Generator().manual_seed(2)) * 0.05
    body = dance.joints() + noise.double().cumsum(1) * 0.3
    return body.double()[:, :40]


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_features_equal_the_slow_loop(joints, fps):
    fast = geometric_features(joints, fps=fps)
    np.testing.assert_allclose(fast, slow_features(joints, fps), atol=1e-9)


def test_thresholds_are_those_of_the_notes():
    """One that is off by a little would pass in few frames only."""
    assert [limit for *_, limit in TESTS] == [limit for *_, limit in LIST]


def test_every_test_both_holds_and_fails_somewhere():
    wild = torch.randn(2, 40, 24, 3, generator=torch.Generator().manual_seed(2)).double() * 0.4
    x = geometric_features(wild)
    np.testing.assert_allclose(x, slow_features(wild, 30.0), atol=1e-9)
    never, always = (x.mean(0) == 0).nonzero(), (x.mean(0) == 1).nonzero()
    assert not len(never)
    assert {NAMES[k] for k in always} <= {n for n in NAMES if "fast" in n}


def test_published_variants_equal_the_slow_loop_with_their_bugs(joints):
    for fps in (30.0, 60.0):  # whatever the rate, 1/120 s a frame
        aist = geometric_features(joints, fps=fps, compat="aist")
        np.testing.assert_allclose(aist, slow_features(joints, 120.0, True), atol=1e-9)
    lodge = geometric_features(joints[:, :, :22], compat="lodge")
    slow = slow_features(lodge_positions(joints[:, :, :22]), 120.0, True)
    np.testing.assert_allclose(lodge, slow, atol=1e-9)
    assert (lodge - aist).abs().max() > 0.1


def rest():
    body = torch.zeros(24, 3, dtype=torch.float64)
    for k, parent in enumerate(SMPL24.parents):
        body[k] = SMPL24.offsets[k] + (body[parent] if parent >= 0 else 0)
    return body.expand(11, 24, 3).clone()


def passed(joints, compat=None):
    x = geometric_features(joints, compat=compat)
    return {name for name, value in zip(NAMES, x, strict=True) if value == 1}


def moved(joint, velocity):
    """The rest pose with one joint moving, metres a second."""
    body = rest()
    body[:, SMPL24.names.index(joint)] += torch.arange(11.0)[:, None] / 30 * torch.tensor(velocity)
    return body


def test_names_say_what_the_tests_do():
    still = passed(rest())
    assert {"hands wide apart", "left upper arm off the body"} <= still
    assert not any("fast" in name or "moves" in name for name in still)
    assert passed(moved("rwrist", (0.0, 0.6, 0.0))) - still == {"right hand moves up"}
    forward = passed(moved("lwrist", (0.0, 0.0, 0.7)))
    assert forward - still == {"left hand moves forward", "left hand fast"}
    back = passed(moved("rwrist", (0.0, 0.0, -0.7)))
    assert back - still == {"right hand moves back", "right hand fast"}
    inward = passed(moved("lwrist", (-0.5, 0.0, 0.0)))  # x points to the body's left
    assert inward - still == {"hands approach", "left hand to right side"}
    lying = rest() @ torch.tensor([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]).double()
    assert "body lies" in passed(lying)


def test_the_published_moves_look_at_the_wrong_joints():
    up = moved("rwrist", (0.0, 0.6, 0.0))
    assert "right hand moves up" not in passed(up, "aist")
    apart, closer = moved("lwrist", (0.5, 0.0, 0.0)), moved("lwrist", (-0.5, 0.0, 0.0))
    assert "hands approach" in passed(apart, "aist") - passed(closer, "aist")
    assert "hands approach" in passed(closer) - passed(apart)
    slow = moved("rwrist", (0.0, 0.0, 0.3))  # 0.3 m a second is not fast, 1.2 is
    assert "right hand fast" in passed(slow, "aist") - passed(slow)


def test_turning_and_moving_the_stage_change_nothing(joints):
    R = axis_angle_to_matrix(torch.tensor([0.0, 1.1, 0.0], dtype=torch.float64))
    away = joints @ R.mT + torch.tensor([30.0, 5.0, -7.0])
    torch.testing.assert_close(
        geometric_features(away), geometric_features(joints), atol=1e-9, rtol=0
    )


def test_22_joints_will_do_and_leading_axes_stay(joints):
    x = geometric_features(joints)
    assert x.shape == (3, 32)
    assert len(NAMES) == len(set(NAMES)) == 32
    assert ((x >= 0) & (x <= 1)).all()
    assert torch.equal(geometric_features(joints[1]), x[1])
    assert torch.equal(geometric_features(torch.stack([joints, joints.flip(0)]))[1, 0], x[2])
    assert geometric_features(joints[:, :, :22]).shape == (3, 32)


def test_a_frozen_dancer_passes_no_test_of_movement(dance):
    frozen = dance.joints()[:, :1].expand(-1, 60, -1, -1)
    x = geometric_features(frozen)
    moves = ("moves", "approach", "to right side", "to left side", "fast")
    for k, name in enumerate(NAMES):
        if any(word in name for word in moves):
            assert x[:, k].abs().max() == 0, name
    assert set(x.unique().tolist()) == {0.0, 1.0}


def test_shaking_makes_everything_fast(dance):
    good = geometric_features(dance.joints()).mean(0)
    shaken = corruption.jitter(dance, 0.5, np.random.default_rng(0))
    bad = geometric_features(shaken.joints()).mean(0)
    fast = [k for k, name in enumerate(NAMES) if "fast" in name]
    assert len(fast) == 5
    assert (bad[fast] > good[fast]).all()


def test_bad_input_is_named(joints):
    with pytest.raises(ValueError, match=r"1 frames.*2"):
        geometric_features(joints[:, :1])
    with pytest.raises(ValueError, match="joints has shape"):
        geometric_features(joints[:, :, :20])
    with pytest.raises(ValueError, match="fps"):
        geometric_features(joints, fps=-1)
    with pytest.raises(ValueError, match=r"compat='gcd'.*'lodge', 'aist'"):
        geometric_features(joints, compat="gcd")
    bad = joints.clone()
    bad[1, 3, 0, 0] = float("inf")
    with pytest.raises(ValueError, match="NaN"):
        geometric_features(bad)
