import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.metrics import corruption
from dancediff.metrics.kinetic import kinetic_features
from dancediff.motion.rotation import axis_angle_to_matrix


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.3, 2, 0.5), dancers=2, seed=1, seconds=2)[0]


@pytest.fixture(scope="module")
def joints(dance):
    return dance.joints().double()


def slow_kinetic(p, dt, *, bug=False):
    """Of one joint's path (f, 3), written from the formula."""
    f, rows = len(p), []
    for i in range(1, f):
        v, a = [], []
        for k in range(-2, 3):
            if 0 <= i + k - 1 and i + k < f:
                v.append((p[i + k] - p[i + k - 1]) / dt)
            if 0 <= i + k - 1 and i + k + 1 < f:
                later = (p[i + k + 1] - p[i + k]) / dt
                if bug:
                    before = p[i + k] - p[i + k - 1] / dt
                else:
                    before = (p[i + k] - p[i + k - 1]) / dt
                a.append((later - before) / dt)
        v, a = sum(v) / len(v), sum(a) / len(a)
        rows.append([v[0] ** 2 + v[2] ** 2, v[1] ** 2, np.linalg.norm(a)])
    return np.mean(rows, 0)


def slow_features(joints, dt, *, bug=False):
    J = joints.numpy()
    return np.stack([
        np.concatenate([slow_kinetic(x[:, k], dt, bug=bug) for k in range(x.shape[1])]) for x in J
    ])  # fmt: skip


def slow_lodge(joints):
    out = joints.clone()
    for d in range(len(out)):
        for i in range(joints.shape[1]):
            out[d, i, 0] = joints[d, i, 0] - joints[d, 0, 0]
            out[d, i, 1:] = joints[d, i, 1:] - joints[d, i, 0]
    return out


@pytest.mark.parametrize("f", [3, 4, 25])
def test_features_equal_the_slow_loop(joints, f):
    J = joints[:, :f]
    np.testing.assert_allclose(kinetic_features(J), slow_features(J, 1 / 30), atol=1e-5)
    np.testing.assert_allclose(kinetic_features(J, fps=50), slow_features(J, 1 / 50), atol=1e-5)


@pytest.mark.parametrize(("compat", "dt"), [("aist", 1 / 60), ("gcd", 1 / 30), ("lodge", 1 / 60)])
def test_published_variants_equal_the_slow_loop_with_their_bugs(joints, compat, dt):
    J = joints[:, :12]
    slow = slow_features(slow_lodge(J) if compat == "lodge" else J, dt, bug=True)
    np.testing.assert_allclose(kinetic_features(J, compat=compat), slow, rtol=1e-9, atol=1e-5)
    np.testing.assert_allclose(kinetic_features(J, fps=90, compat=compat), slow, rtol=1e-9)


def test_the_order_is_horizontal_vertical_expenditure():
    up = torch.zeros(9, 24, 3, dtype=torch.float64)
    up[:, 5, 1] = torch.arange(9.0) * 2
    up[:, 7] = torch.arange(9.0)[:, None] * torch.tensor([3.0, 0.0, 4.0])
    up[:, 9, 2] = torch.arange(9.0) ** 2
    x = kinetic_features(up, fps=1.0).view(24, 3)
    assert x[5].tolist() == [0.0, 4.0, 0.0]
    assert x[7].tolist() == [25.0, 0.0, 0.0]
    assert x[9, 1:].tolist() == [0.0, 2.0]
    assert x[[0, 1, 2]].abs().max() == 0


def test_turning_and_moving_the_stage_change_nothing(joints):
    R = axis_angle_to_matrix(torch.tensor([0.0, 1.1, 0.0], dtype=torch.float64))
    moved = joints @ R.mT + torch.tensor([30.0, 5.0, -7.0])
    torch.testing.assert_close(kinetic_features(moved), kinetic_features(joints))


def test_the_published_acceleration_grows_with_the_distance_from_the_origin(joints):
    far = joints + torch.tensor([30.0, 0.0, 0.0])
    expenditure = kinetic_features(far, compat="aist").view(2, 24, 3)[..., 2]
    assert (expenditure > 29 * 60**2 * 0.95).all()  # about p / dt^2
    assert kinetic_features(joints).view(2, 24, 3)[..., 2].max() < 200
    a, b = (kinetic_features(x, compat="lodge") for x in (joints, far))
    torch.testing.assert_close(a, b)  # its root begins at the origin


def test_speeds_do_not_depend_on_the_frame_rate_but_published_ones_do():
    def dance(fps):
        t = torch.arange(0, 4, 1 / fps, dtype=torch.float64)[:, None, None]
        phase = torch.rand(1, 24, 3, generator=torch.Generator().manual_seed(3))
        return 0.2 * torch.sin(3 * t + 6 * phase)

    slow, fast = kinetic_features(dance(30)), kinetic_features(dance(60), fps=60)
    torch.testing.assert_close(slow, fast, rtol=0.03, atol=1e-3)
    a, b = (kinetic_features(dance(fps), fps=fps, compat="aist") for fps in (30, 60))
    # 30 fps data taken for 60: every squared speed is 4 times too large
    torch.testing.assert_close(a.view(24, 3)[:, :2], 4 * slow.view(24, 3)[:, :2])
    assert (a.view(24, 3)[:, 1] > 3.5 * b.view(24, 3)[:, 1]).all()


def test_22_joints_give_the_first_66_numbers_and_leading_axes_stay(joints):
    x = kinetic_features(joints)
    assert x.shape == (2, 72)
    assert torch.equal(kinetic_features(joints[:, :, :22]), x[:, :66])
    assert torch.equal(kinetic_features(joints[1]), x[1])
    assert torch.equal(kinetic_features(torch.stack([joints, joints.flip(0)])[:, :1])[1, 0], x[1])
    assert x.dtype == torch.float64
    torch.testing.assert_close(kinetic_features(joints.float()), x, rtol=1e-3, atol=1e-3)


def test_a_frozen_dancer_has_none_and_a_shaken_one_more(dance, joints):
    good = kinetic_features(joints)
    assert kinetic_features(joints[:, :1].expand(-1, 60, -1, -1)).abs().max() == 0
    shaken = corruption.jitter(dance, 0.5, np.random.default_rng(0)).joints()
    assert (kinetic_features(shaken).mean(1) > 2 * good.mean(1)).all()


def test_bad_input_is_named(joints):
    with pytest.raises(ValueError, match=r"2 frames.*3"):
        kinetic_features(joints[:, :2])
    with pytest.raises(ValueError, match=r"joints has shape \(2, 60, 24, 2\)"):
        kinetic_features(joints[..., :2])
    with pytest.raises(ValueError, match="joints has shape"):
        kinetic_features(joints[0, 0])
    with pytest.raises(ValueError, match="fps"):
        kinetic_features(joints, fps=0)
    with pytest.raises(ValueError, match=r"compat='edge'.*'lodge', 'aist', 'gcd'"):
        kinetic_features(joints, compat="edge")
    bad = joints.clone()
    bad[1, 3, 0, 0] = float("nan")
    with pytest.raises(ValueError, match="NaN"):
        kinetic_features(bad)
