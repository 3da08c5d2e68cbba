import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.data.choreographer.formations import formation_names, min_distance, slots
from dancediff.data.choreographer.vocabulary import ARM_POSES, FOOTWORK, MOVES, TRAVEL
from dancediff.motion.beats import motion_beats
from dancediff.motion.contact import FOOT_JOINTS, feet_low, foot_contact, foot_speed


def grid(seed, seconds=14.0):
    rng = np.random.default_rng(seed)
    return np.arange(rng.uniform(0, 0.5), seconds, 60 / rng.uniform(85, 145))


@pytest.fixture(scope="module")
def dances():
    """A hundred dances of 12 s: every group size, many tempi."""
    return [choreograph(grid(k), dancers=1 + k % 5, seed=k, seconds=12) for k in range(100)]


def test_nothing_is_broken(dances):
    for dance, _ in dances:
        joints = dance.joints()
        assert dance.num_frames == 360 and joints.isfinite().all()
        assert joints[..., 1].min() > -0.005 and joints[..., 1].max() < 2.3
        assert dance.root.diff(dim=1).norm(dim=-1).max() < 0.08


def test_planted_feet_do_not_move(dances):
    for dance, truth in dances:
        feet = dance.joints()[:, :, FOOT_JOINTS]
        planted = (truth.contacts[:, 1:] * truth.contacts[:, :-1]).bool()
        assert planted.float().mean() > 0.3
        assert feet.diff(dim=1).norm(dim=-1)[planted].max() < 0.002


def test_planted_feet_are_on_the_floor(dances):
    for dance, truth in dances:
        assert feet_low(dance.joints())[truth.contacts.bool()].all()


def test_contact_rule_agrees_with_the_plan(dances):
    agree = [(foot_contact(m.joints()) == t.contacts).float().mean().item() for m, t in dances]
    assert np.mean(agree) > 0.9


def test_low_feet_hardly_slide(dances):
    still = [
        (foot_speed(j)[feet_low(j)] < 0.015).float().mean() for j in (m.joints() for m, _ in dances)
    ]
    assert np.mean(still) > 0.95


def test_the_beat_can_be_seen(dances):
    hits = [
        np.mean([np.abs(motion_beats(joints) - beat).min() <= 2 for beat in truth.beats])
        for dance, truth in dances
        for joints in dance.joints()
    ]
    assert np.mean(hits) > 0.85 and np.quantile(hits, 0.02) > 0.7


def test_a_shifted_beat_is_seen_less(dances):
    """The test above can fail: half a beat off, the hits drop."""
    dance, truth = dances[3]
    half = int(np.diff(truth.beats).mean() / 2)
    found = [motion_beats(joints) for joints in dance.joints()]
    on, off = (
        np.mean([np.abs(m - b).min() <= 2 for m in found for b in truth.beats[:-1] + shift])
        for shift in (0, half)
    )
    assert on > off + 0.2


def test_nobody_collides(dances):
    assert min(min_distance(m.root[..., (0, 2)].numpy()) for m, _ in dances) > 0.45


def test_truth_tells_order_and_formation(dances):
    swapped = 0
    for dance, truth in dances:
        x = dance.root[..., 0].numpy()
        assert (np.diff(x[truth.order_start, 0]) > 0).all()
        assert (np.diff(x[truth.order_end, -1]) > 0).all()
        swapped += not np.array_equal(truth.order_start, truth.order_end)
        for frame, _, place in truth.formations[1:]:
            at = dance.root[:, frame][:, (0, 2)].numpy()
            assert np.abs(at - place).max() < 0.6
    assert swapped > 5


def test_same_seed_same_dance_other_seed_other_dance():
    a, b, c = (choreograph(grid(0), dancers=3, seed=s)[0] for s in (4, 4, 5))
    assert torch.equal(a.pose, b.pose) and torch.equal(a.root, b.root)
    assert not torch.allclose(a.root, c.root, atol=0.05)


def test_random_global_state_is_not_used():
    np.random.seed(0)  # noqa: NPY002 - the point of this test
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    torch_before = torch.get_rng_state()
    choreograph(grid(0), dancers=2, seed=0)
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002
    assert torch.equal(torch.get_rng_state(), torch_before)


@pytest.mark.parametrize("n", range(1, 6))
def test_formations_have_a_left_to_right_order(n):
    for name in formation_names(n):
        place = slots(n, name)
        assert place.shape == (n, 2) and (np.diff(place[:, 0]) >= 0.3).all()
        assert min_distance(place[:, None]) > 0.75


def test_vocabulary_is_whole():
    for move in [*MOVES, TRAVEL]:
        assert move.feet in FOOTWORK and len(FOOTWORK[move.feet]) == 8
        assert len(move.left) == len(move.right) == len(move.torso) == 8
        assert {*move.left, *move.right} <= set(ARM_POSES)


@pytest.mark.parametrize("bad", [{"dancers": 0}, {"dancers": 6}, {"seconds": -1.0}])
def test_bad_arguments_are_named(bad):
    with pytest.raises(ValueError, match=f"{next(iter(bad))}={next(iter(bad.values()))}"):
        choreograph(grid(0), **bad)


def test_bad_beats_are_named():
    with pytest.raises(ValueError, match="beats"):
        choreograph([0.0, 1.0, 0.5, 2.0])
