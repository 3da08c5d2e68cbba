from itertools import permutations

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.data.cmu import cmu_jobs
from dancediff.metrics.corruption import shuffle_time
from dancediff.metrics.swaps import (
    abrupt_swaps,
    final_order,
    obeys,
    permutation_kind,
    swap_obedience,
)
from dancediff.motion.rotation import axis_angle_to_matrix


def line(x, f=40):
    """Dancers who stand at these places, (n, f, 3)."""
    root = torch.zeros(len(x), f, 3)
    root[..., 0] = torch.tensor(x)[:, None]
    root[..., 1] = 0.9
    return root


def walk(start, end, f=40):
    """Dancers who walk straight from one place to another."""
    s = torch.linspace(0, 1, f)[None, :, None]
    return (1 - s) * line(start, f) + s * line(end, f)


def kinds(swaps):
    return [(swap.kind, swap.frame, swap.dancers) for swap in swaps]


def slow_abrupt(root, fps, seams):
    n, f, _ = root.shape
    found = set()
    for d in range(n):
        for t in range(1, f):
            if (root[d, t] - root[d, t - 1]).norm() > 0.12 * 30 / fps:
                found.add(("jump", t, (d,)))
    w = max(1, round(3 * fps / 30))
    for s in seams:
        before, after = max(0, s - w), min(f - 1, s + w)
        for i in range(n):
            for j in range(i + 1, n):
                jumped = any(
                    ("jump", t, (d,)) in found for d in (i, j) for t in range(before + 1, after + 1)
                )
                p, q = ({d: root[d, t, [0, 2]] for d in (i, j)} for t in (before, after))
                kept = ((q[i] - p[i]) ** 2).sum() + ((q[j] - p[j]) ** 2).sum()
                traded = ((q[i] - p[j]) ** 2).sum() + ((q[j] - p[i]) ** 2).sum()
                if traded < kept and not jumped:
                    found.add(("exchange", s, (i, j)))
    return found


@pytest.mark.parametrize("fps", [30.0, 60.0, 25.0])
def test_equals_the_slow_loop(fps):
    g = torch.Generator().manual_seed(0)
    size = 0.05 * 30 / fps  # some steps are jumps, most are not
    root = (size * torch.randn(4, 90, 3, generator=g, dtype=torch.float64)).cumsum(1)
    root[2] = 0.1 * root[2] + root[3, 44]  # two who are near each other, one of them calm
    root[3] = 0.3 * root[3] + 0.7 * root[3, 44]
    seams = list(range(1, 90))
    fast = kinds(abrupt_swaps(root, fps=fps, seams=seams))
    assert set(fast) == slow_abrupt(root, fps, seams)
    assert len(set(fast)) == len(fast)
    assert {kind for kind, *_ in fast} == {"jump", "exchange"}


def test_a_jump_is_twelve_centimetres_in_a_frame():
    for step, count in ((0.119, 0), (0.121, 1)):
        root = line([0.0, 2.0])
        root[1, 20:, 2] += step
        assert len(abrupt_swaps(root)) == count
        assert len(abrupt_swaps(root, fps=15.0)) == 0  # half the speed
        assert len(abrupt_swaps(root, fps=60.0)) == 1
    (swap,) = abrupt_swaps(root)
    assert (swap.frame, swap.dancers) == (20, (1,))
    assert swap.metres == pytest.approx(0.121, abs=1e-6)


def test_walking_through_each_other_is_ordinary():
    root = walk([-1.0, 1.0], [1.0, -1.0])
    root[0, :, 2] += 0.4
    assert abrupt_swaps(root, seams=range(1, 40)) == []
    assert final_order(root) == (1, 0)  # though the order does change


def test_trading_places_at_a_seam_counts_and_elsewhere_does_not():
    root = line([0.0, 0.3, 3.0])
    ramp = torch.linspace(0, 1, 6)  # 6 cm a frame: no jump
    root[0, 17:23, 0], root[1, 17:23, 0] = 0.3 * ramp, 0.3 - 0.3 * ramp
    root[0, 23:, 0], root[1, 23:, 0] = 0.3, 0.0
    assert kinds(abrupt_swaps(root, seams=[20])) == [("exchange", 20, (0, 1))]
    assert abrupt_swaps(root, seams=[30]) == []
    assert abrupt_swaps(root) == []


def test_an_exchange_by_jumps_counts_as_its_jumps():
    root = line([0.0, 1.0])
    root[:, 20:] = root[:, 20:].flip(0)
    expected = [("jump", 20, (0,)), ("jump", 20, (1,))]
    assert kinds(abrupt_swaps(root, seams=[20])) == expected == kinds(abrupt_swaps(root))


def test_turning_and_moving_the_stage_change_nothing():
    g = torch.Generator().manual_seed(1)
    root = (0.035 * torch.randn(3, 80, 3, generator=g, dtype=torch.float64)).cumsum(1)
    R = axis_angle_to_matrix(torch.tensor([0.0, 2.0, 0.0], dtype=torch.float64))
    seams = range(1, 80)
    moved = abrupt_swaps(root @ R.mT + torch.tensor([5.0, 0, -2]), seams=seams)
    assert kinds(moved) == kinds(abrupt_swaps(root, seams=seams)) != []


def test_real_duets_change_sides_but_never_abruptly(real_data):
    if not (real_data / "cmu" / "manifest.json").is_file():
        pytest.skip(f"no cmu/manifest.json in {real_data}")
    changes = 0
    for job in cmu_jobs(real_data / "cmu"):
        if job.name in ("salsa_09", "salsa_10", "salsa_13"):
            root = job.make().motion.root
            assert abrupt_swaps(root, seams=range(1, root.shape[1])) == []  # any frame as a seam
            changes += (root[0, :, 0] < root[1, :, 0]).int().diff().abs().sum().item()
    assert changes > 10


def test_final_order_speaks_of_ranks_at_the_first_frame():
    root = walk([-1.0, 0.0, 1.0], [0.2, -1.0, 1.0])
    assert final_order(root) == (1, 0, 2)
    for numbering in permutations(range(3)):
        assert final_order(root[list(numbering)]) == (1, 0, 2)


def test_choreographed_swaps_are_obeyed():
    for seed in range(6):
        dance, truth = choreograph([0.5 * k for k in range(40)], dancers=3, seed=seed)
        rank = truth.order_start.argsort()
        assert obeys(dance.root, rank[truth.order_end])
        assert len(abrupt_swaps(dance.root)) == 0


def test_obedience_is_counted_per_kind():
    keep = line([-1.0, 0.0, 1.0])
    roots, swaps = [], list(permutations(range(3)))
    for _ in swaps:
        roots.append(keep)
    assert swap_obedience(roots, swaps) == {
        "all": pytest.approx(1 / 6),
        "identity": 1.0,
        "neighbours": 0.0,
        "outer": 0.0,
        "rotation": 0.0,
    }
    places = [-1.0, 0.0, 1.0]
    obedient = [walk(places, [places[swap.index(d)] for d in range(3)]) for swap in swaps]
    assert set(swap_obedience(obedient, swaps).values()) == {1.0}
    duet = walk([0.0, 1.0], [1.0, 0.0])
    assert swap_obedience([duet, duet], [[1, 0], torch.tensor([0, 1])]) == {"all": 0.5}


def test_turning_the_stage_by_half_mirrors_the_order():
    root = walk([-1.0, 0.0, 1.0], [0.0, -1.0, 1.0])
    assert final_order(root) == (1, 0, 2)
    assert final_order(root * torch.tensor([-1.0, 1, -1])) == (0, 2, 1)  # obedience may change


def test_six_orders_have_four_kinds():
    found = [permutation_kind(swap) for swap in permutations(range(3))]
    assert found == ["identity", "neighbours", "neighbours", "rotation", "rotation", "outer"]


def test_bad_input_is_named():
    root = line([0.0, 1.0])
    with pytest.raises(ValueError, match=r"root.*\(2, 40, 2\)"):
        abrupt_swaps(root[..., :2])
    with pytest.raises(ValueError, match="1 frames"):
        abrupt_swaps(root[:, :1])
    with pytest.raises(ValueError, match="fps"):
        abrupt_swaps(root, fps=-1)
    for seams in ([0], [40], [1.5], 5):
        with pytest.raises(ValueError, match="seams"):
            abrupt_swaps(root, seams=seams)
    with pytest.raises(ValueError, match=r"swap=\[0, 0\]"):
        obeys(root, [0, 0])
    with pytest.raises(ValueError, match="swap"):
        permutation_kind([1, 0])
    with pytest.raises(ValueError, match="1 roots and 2 swaps"):
        swap_obedience([root], [[0, 1], [0, 1]])
    with pytest.raises(ValueError, match="0 roots"):
        swap_obedience([], [])
    root[0, 3, 0] = float("inf")
    with pytest.raises(ValueError, match="NaN"):
        abrupt_swaps(root)


def test_shuffling_adds_jumps_step_by_step():
    dances = [choreograph([0.5 * k for k in range(24)], dancers=3, seed=s)[0] for s in range(5)]
    values = [
        sum(
            len(abrupt_swaps(shuffle_time(dance, a, np.random.default_rng(s)).root))
            for s, dance in enumerate(dances)
        )
        for a in (0, 0.25, 0.5, 1)
    ]
    assert values == sorted(values)
    assert values[0] == 0 < values[1] < values[-1]
