import time

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.data.cmu import cmu_jobs
from dancediff.metrics import corruption
from dancediff.metrics.fidelity import fid
from dancediff.metrics.group import (
    dtw,
    dtw_ref,
    frame_energies,
    frame_energies_ref,
    gmc,
    gmr,
    group_features,
)
from dancediff.motion.rotation import axis_angle_to_matrix


def wander(n=3, f=20, j=24, seed=0):
    g = torch.Generator().manual_seed(seed)
    steps = torch.randn(n, f, j, 3, generator=g, dtype=torch.float64)
    return steps.cumsum(1) * 0.02 + torch.randn(n, 1, 1, 3, generator=g, dtype=torch.float64)


def slow_gmc(joints, dt, *, shift=-1, power=1):
    n, f, _, _ = joints.shape
    phi = torch.log(1 + 1.5 * frame_energies_ref(joints, window=2, dt=dt)).flatten(2)
    total, pairs = 0.0, 0
    for d in range(n):
        for e in range(d + 1, n):
            cost = torch.stack([
                torch.stack([((p - q) ** 2).sum() ** (power / 2) for q in joints[e]])
                for p in joints[d]
            ])  # fmt: skip
            values = [
                (phi[d][i + shift] * phi[e][k + shift]).sum().item()
                for i, k in dtw_ref(cost).tolist()
                if 0 <= i + shift < f - 1 and 0 <= k + shift < f - 1
            ]
            total, pairs = total + sum(values) / len(values), pairs + 1
    return total / pairs


@pytest.mark.parametrize("f", [3, 4, 20])
@pytest.mark.parametrize("w", [1, 2])
def test_energies_equal_the_slow_loop(f, w):
    joints, options = wander(f=f, j=5), {"window": w, "dt": 1 / 25}
    slow = frame_energies_ref(joints, **options)
    assert slow.shape == (3, f - 1, 5, 3)
    torch.testing.assert_close(frame_energies(joints, **options), slow, rtol=1e-9, atol=1e-9)


def test_group_features_equal_the_slow_loop_and_keep_the_order():
    joints = wander()
    mean = frame_energies_ref(joints, window=1, dt=1 / 30).mean((0, 1))
    slow = torch.log(1 + 1.5 * mean).flatten()  # joint by joint, three numbers each
    assert torch.allclose(group_features(joints), slow, atol=1e-9)
    up = torch.zeros(2, 5, 24, 3)
    up[..., 1] = torch.arange(5.0)[:, None]  # every joint rises by a metre a frame
    features = group_features(up, fps=1.0).view(24, 3)
    assert torch.allclose(features[:, 1], torch.tensor(2.5, dtype=torch.float64).log())
    assert (features[:, (0, 2)] == 0).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (6, 1), (12, 9), (20, 20)])
def test_dtw_equals_the_slow_loop(shape):
    cost = torch.rand(shape, generator=torch.Generator().manual_seed(sum(shape)))
    assert dtw(cost).tolist() == dtw_ref(cost.double()).tolist()


def test_dtw_follows_a_delay_and_takes_both_steps_of_equal_ways():
    x = torch.sin(torch.arange(60.0) / 4)
    path = dtw((x[:50, None] - x[None, 10:]).abs())
    inner = path[(path[:, 1] > 2) & (path[:, 1] < 38)]
    assert (inner[:, 0] - inner[:, 1] == 10).all()
    assert dtw(torch.zeros(4, 4)).tolist() == [[k, k] for k in range(4)]
    with pytest.raises(ValueError, match="cost"):
        dtw(torch.tensor([[float("nan")]]))


def test_gmc_equals_the_slow_loop():
    path = wander(1, 25)[0]
    joints = torch.stack([path[4 * d : 4 * d + 15] for d in range(3)])  # one behind the other
    cost = torch.cdist(joints[0].flatten(1), joints[1].flatten(1))
    assert dtw(cost).tolist() != [[k, k] for k in range(15)]
    assert gmc(joints) == pytest.approx(slow_gmc(joints, 1 / 30), abs=1e-9)
    assert gmc(joints, fps=60.0) == pytest.approx(slow_gmc(joints, 1 / 60), abs=1e-9)
    assert gmc(joints.float()) == pytest.approx(gmc(joints), rel=1e-4)
    published = slow_gmc(joints, 1 / 30, shift=0, power=2)
    assert gmc(joints, fps=60.0, compat="gcd") == pytest.approx(published, abs=1e-9)
    assert abs(published - gmc(joints)) > 0.1


def test_turning_moving_and_renumbering_change_nothing():
    joints = wander(f=30)
    R = axis_angle_to_matrix(torch.tensor([0.0, 1.1, 0.0], dtype=torch.float64))
    moved = joints @ R.mT + torch.tensor([3.0, 0.5, -7.0])
    assert torch.allclose(group_features(moved), group_features(joints), atol=1e-9)
    assert gmc(moved) == pytest.approx(gmc(joints), abs=1e-9)
    assert gmc(joints[[2, 0, 1]]) == pytest.approx(gmc(joints), abs=1e-9)
    assert torch.allclose(group_features(joints[[2, 0, 1]]), group_features(joints), atol=1e-12)


def test_a_dance_at_twice_the_rate_measures_nearly_the_same():
    def dance(fps):
        t = torch.arange(0, 4, 1 / fps, dtype=torch.float64)[None, :, None, None]
        phase = torch.rand(2, 1, 24, 3, generator=torch.Generator().manual_seed(3))
        return 0.2 * torch.sin(3 * t + 6 * phase)

    # the window spans half the time, which matters little for movement as slow as this
    assert torch.allclose(group_features(dance(60), fps=60), group_features(dance(30)), atol=0.01)
    assert gmc(dance(60), fps=60.0) == pytest.approx(gmc(dance(30)), rel=0.02)
    published = gmc(dance(60), fps=60.0, compat="gcd")
    assert published < 0.7 * gmc(dance(30))  # dt stays 1/30


def test_unison_beats_dancers_who_move_at_other_times():
    t = torch.arange(120.0) / 30
    burst = ((t % 2) < 1).double()  # a second of movement, a second of rest
    path = (burst * torch.sin(8 * t)).cumsum(0) * 0.02
    a = path[None, :, None, None].expand(1, -1, 24, 3)
    b = path.roll(30)[None, :, None, None].expand(1, -1, 24, 3)
    assert gmc(torch.cat([a, a])) > gmc(torch.cat([a, b])) > 0


def test_gmc_of_five_dancers_and_720_frames_is_quick():
    dance, _ = choreograph([0.5 * k for k in range(50)], dancers=5, seed=2, seconds=24)
    joints = dance.joints()
    start = time.process_time()
    value = gmc(joints)
    assert time.process_time() - start < 5
    assert joints.shape[1] == 720
    assert 0 < value < 200


def test_gmr_is_the_frechet_distance_of_the_groups():
    """The reference comes second: its spread is the unit."""
    g = torch.Generator().manual_seed(0)
    x = 2 * torch.randn(200, 72, generator=g).double() + 1
    reference = torch.randn(300, 72, generator=g).double()
    assert gmr(x, reference) == pytest.approx(fid(x, reference))
    assert abs(fid(x, reference) - fid(reference, x)) > 1


def test_real_duets_have_a_finite_gmc(real_data):
    if not (real_data / "cmu" / "manifest.json").is_file():
        pytest.skip(f"no cmu/manifest.json in {real_data}")
    job = next(job for job in cmu_jobs(real_data / "cmu") if job.name == "salsa_10")
    joints = job.make().motion.joints()
    assert 40 < gmc(joints) < 100  # measured 65.2
    assert gmc(joints[:, :1].expand(-1, 30, -1, -1)) == 0.0  # frozen


@pytest.mark.parametrize("metric", [gmc, group_features])
def test_bad_input_is_named(metric):
    joints = wander()
    with pytest.raises(ValueError, match=r"1 dancer.*2"):
        metric(joints[:1])
    with pytest.raises(ValueError, match=r"2 frames.*3"):
        metric(joints[:, :2])
    with pytest.raises(ValueError, match=r"joints.*\(3, 20, 24, 2\)"):
        metric(joints[..., :2])
    with pytest.raises(ValueError, match="fps"):
        metric(joints, fps=0.0)
    with pytest.raises(ValueError, match=r"compat='edge'.*gcd"):
        metric(joints, compat="edge")
    joints[1, 3, 0, 0] = float("nan")
    with pytest.raises(ValueError, match="NaN"):
        metric(joints)


def mean_of_five(damage, amount):
    values = []
    for seed in range(5):
        beats = [0.5 * k for k in range(14)]
        dance, _ = choreograph(beats, dancers=3, seed=seed, seconds=5)
        bad = damage(dance, amount, np.random.default_rng(seed))
        values.append(gmc(bad.joints()))
    return sum(values) / 5


@pytest.mark.parametrize("damage", [corruption.freeze, corruption.mean_pose])
def test_less_movement_lowers_gmc_step_by_step(damage):
    values = [mean_of_five(damage, amount) for amount in (0, 0.25, 0.5, 0.75, 1)]
    assert values == sorted(values, reverse=True)
    assert values[-1] < 0.7 * values[0]


def test_shaking_fools_gmc():
    """What the documentation warns of; if this fails, the warning may go."""
    assert mean_of_five(corruption.jitter, 0.5) > 2 * mean_of_five(corruption.jitter, 0)
