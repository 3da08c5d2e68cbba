import time
from itertools import combinations

import numpy as np
import pytest
import torch
from scipy.optimize import lsq_linear

from dancediff.data.choreographer import choreograph
from dancediff.data.cmu import cmu_jobs
from dancediff.metrics.collision import (
    CAPSULES,
    POINTS,
    body_points,
    segment_distance,
    tif,
    touches,
)
from dancediff.metrics.corruption import overlap_dancers
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import forward_kinematics


def standing(n=2, f=3, *, apart=5.0, seed=None):
    """Dancers in the rest pose side by side, or in random poses when there is a seed."""
    root = torch.zeros(n, f, 3)
    root[:, :, 0] = apart * torch.arange(n)[:, None]
    pose = torch.eye(3).expand(n, f, 24, 3, 3)
    if seed is not None:
        g = torch.Generator().manual_seed(seed)
        pose = axis_angle_to_matrix(0.5 * torch.randn(n, f, 24, 3, generator=g))
        root = root + 0.3 * torch.randn(n, f, 3, generator=g)
    return forward_kinematics(pose, root).double()


def exact_distance(a, b, c, d):
    """The quadratic problem of two segments, by a solver that knows nothing of geometry."""
    A = np.stack([b - a, -(d - c)], 1)
    s, t = lsq_linear(A, c - a, bounds=(0, 1), tol=1e-14).x
    return np.linalg.norm(a + s * (b - a) - c - t * (d - c))


def slow_touches(joints):
    points = body_points(joints).numpy()
    rows = []
    for i, j in combinations(range(len(points)), 2):
        hit = [
            any(
                exact_distance(p[a], p[b], q[c], q[d]) < r + s
                for _, a, b, r in CAPSULES
                for _, c, d, s in CAPSULES
            )
            for p, q in zip(points[i], points[j], strict=True)
        ]
        rows.append(hit)
    return torch.tensor(rows)


def test_segment_distance_equals_a_solver():
    x = torch.randn(300, 4, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    x[:40, 3] = x[:40, 2]  # a point and a segment
    x[40:50, 1], x[40:50, 3] = x[40:50, 0], x[40:50, 2]  # two points
    x[50:90, 3] = x[50:90, 2] + x[50:90, 1] - x[50:90, 0]  # parallel
    share = torch.rand(30, 2, 1, generator=torch.Generator().manual_seed(1))
    x[90:120, 2:] = x[90:120, :1] + share * (x[90:120, 1:2] - x[90:120, :1])  # one on the other
    fast = segment_distance(*x.unbind(1))
    slow = [exact_distance(*row) for row in x.numpy()]
    assert np.allclose(fast.numpy(), slow, atol=1e-6)


def test_capsules_equal_the_slow_loop():
    joints = standing(3, 2, apart=0.5, seed=4)
    fast, slow = touches(joints), slow_touches(joints)
    assert torch.equal(fast, slow)
    assert fast.any() and not fast.all()
    assert tif(joints) == pytest.approx(slow.double().sum().item() / 2, abs=1e-5)


def test_shortcuts_lose_no_touch():
    joints = standing(3, 200, apart=0.8, seed=1)
    points = body_points(joints)
    a, b = (torch.tensor([c[k] for c in CAPSULES]) for k in (1, 2))
    r = torch.tensor([c[3] for c in CAPSULES], dtype=torch.float64)
    whole = torch.stack([
        (
            segment_distance(
                points[i][:, a, None], points[i][:, b, None],
                points[j][:, None, a], points[j][:, None, b],
            ) < r[:, None] + r
        ).any(-1).any(-1)
        for i, j in combinations(range(3), 2)
    ])  # fmt: skip
    assert torch.equal(touches(joints), whole)
    assert 0.05 < whole.double().mean() < 0.95


@pytest.mark.parametrize("bodies", ["capsule", "disc"])
def test_far_is_zero_and_one_place_is_every_pair(bodies):
    assert tif(standing(4), bodies=bodies) == 0.0
    assert tif(standing(2, apart=0.0), bodies=bodies) == 1.0
    assert tif(standing(4, apart=0.0), bodies=bodies) == 6.0
    assert tif(standing(4, apart=0.0), bodies=bodies, ordered=True) == 12.0


def test_hands_touch_where_arms_end():
    """In the rest pose arms point sideways, so dancers touch when fingertips do."""
    tips = body_points(standing(1))[0, 0, [POINTS.index("lfingers"), POINTS.index("rfingers")], 0]
    span = (tips[0] - tips[1]).item() + 2 * 0.03
    assert tif(standing(2, apart=span - 0.005)) == 1.0
    assert tif(standing(2, apart=span + 0.005)) == 0.0


def test_capsules_cover_the_body_alike_on_both_sides():
    names = [name for name, *_ in CAPSULES]
    assert len(set(names)) == len(names)
    used = {point for _, a, b, _ in CAPSULES for point in (a, b)}
    unused = {POINTS[k] for k in set(range(len(POINTS))) - used}
    assert unused == {"belly", "lhand", "rhand"}  # they lie within the abdomen and the hands
    sides = {
        word: [r for name, *_, r in CAPSULES if name.startswith(word)] for word in ("left", "right")
    }
    assert sides["left"] == sides["right"]
    assert all(0.03 <= r <= 0.12 for *_, r in CAPSULES)


def test_turning_and_moving_the_stage_change_nothing():
    joints = standing(3, 60, apart=0.7, seed=2)
    R = axis_angle_to_matrix(torch.tensor([0.0, 0.7, 0.0], dtype=torch.float64))
    moved = joints @ R.mT + torch.tensor([40.0, 0.0, -3.0])
    assert torch.equal(touches(moved), touches(joints))
    assert tif(joints[[2, 0, 1]]) == tif(joints)
    assert tif(joints.float()) == tif(joints)


def test_two_hundred_clips_of_three_dancers_take_seconds():
    clip = standing(3, 150, apart=0.6, seed=3)
    start = time.process_time()
    for _ in range(20):
        tif(clip)
    assert time.process_time() - start < 0.6  # a tenth of the work, in a tenth of 6 s


def test_bad_input_is_named():
    joints = standing()
    with pytest.raises(ValueError, match=r"1 dancer.*2"):
        tif(joints[:1])
    with pytest.raises(ValueError, match=r"bodies='sphere'.*capsule"):
        tif(joints, bodies="sphere")
    with pytest.raises(ValueError, match="22 joints"):
        tif(joints[:, :, :22])
    joints[0, 0, 5, 1] = float("nan")
    with pytest.raises(ValueError, match="NaN"):
        tif(joints)


@pytest.fixture(scope="module")
def duet(real_data):
    if not (real_data / "cmu" / "manifest.json").is_file():
        pytest.skip(f"no cmu/manifest.json in {real_data}")
    job = next(job for job in cmu_jobs(real_data / "cmu") if job.name == "salsa_10")
    return job.make().motion.joints()


def test_real_partners_touch_now_and_then(duet):
    share = tif(duet)
    assert 0.1 < share < 0.5  # measured 0.29
    away = duet.clone()
    away[1, ..., 0] += 3
    assert tif(away) == 0.0
    middle = duet.clone()
    middle[..., [0, 2]] -= duet[:, :, :1][..., [0, 2]]
    assert tif(middle) == 1.0


@pytest.mark.parametrize("bodies", ["capsule", "disc"])
def test_overlap_raises_tif_step_by_step(bodies):
    dances = [choreograph([0.5 * k for k in range(14)], dancers=3, seed=s)[0] for s in range(5)]
    values = [
        sum(
            tif(overlap_dancers(d, a, np.random.default_rng(0)).joints(), bodies=bodies)
            for d in dances
        )
        for a in (0, 0.3, 0.6, 0.8, 1)
    ]
    assert values == sorted(values)
    assert values[0] < 0.3 < values[2] < values[-1] == 15  # five dances of three pairs
