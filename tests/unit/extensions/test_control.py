import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.diffusion.long_sampling import Segment
from dancediff.extensions.constraint import Constraint
from dancediff.extensions.control import (
    HOLD,
    EndAt,
    Keep,
    NearbyFrames,
    StartAt,
    WalkAlong,
    combine,
    final_order,
    initial_order,
    normalized,
)
from dancediff.motion.representation import TCDIFFPP, Normalizer

X, Y, Z = range(4, 7)


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.2, 6, 0.5), dancers=2, seed=1, seconds=4.0)[0]


def known(control, n=2, frames=120):
    return control.constraint(n, frames, 30.0)


def test_formations_fix_the_floor_plane_of_one_frame():
    for control, frame in (
        (StartAt([(-1, 0.5), (1, 0)]), 0),
        (EndAt([(-1, 0.5), (1, 0)]), 119),
    ):
        c = known(control)
        assert c.mask.nonzero().tolist() == [
            [k, frame, channel] for k in range(2) for channel in (X, Z)
        ]
        assert c.value[:, frame, [X, Z]].tolist() == [[-1.0, 0.5], [1.0, 0.0]]


def test_a_path_goes_through_its_points_and_nowhere_else():
    c = known(WalkAlong(1, [(1, 0, 0), (2, 1, -1), (3, 1, 0)]))
    assert not c.mask[0].any() and c.mask[1, 30:91, [X, Z]].all() and c.mask.sum() == 2 * 61
    assert c.value[1, [30, 60, 90], X].tolist() == [0, 1, 1]
    assert c.value[1, [30, 60, 90], Z].tolist() == [0, -1, 0]
    x = c.value[1, 30:91, X]
    assert x.min() >= 0 and x.max() <= 1  # it does not overshoot
    assert c.slack[1, 40, X] == pytest.approx(0.008)


def test_one_point_is_a_place_at_a_time():
    c = known(WalkAlong(0, [(2.0, 0.3, 0.4)]))
    assert c.mask.nonzero().tolist() == [[0, 60, X], [0, 60, Z]]
    assert c.value[0, 60, [X, Z]].tolist() == pytest.approx([0.3, 0.4])
    between = known(WalkAlong(0, [(1.25, 0.3, 0.4)]))  # frame 37.5: it holds in the nearest one
    assert between.mask.nonzero().tolist() == [[0, 38, X], [0, 38, Z]]
    last = known(WalkAlong(0, [(4.0, 0.3, 0.4)]))
    assert last.mask.nonzero().tolist() == [[0, 119, X], [0, 119, Z]]


def test_keeping_frames_joints_and_dancers(dance):
    for seconds in (np.array([0, 1]), np.float32([0, 1])):  # whole numbers or not
        assert torch.equal(known(Keep(dance, seconds)).mask, known(Keep(dance, (0, 1))).mask)
    frames = known(Keep(dance, seconds=[(0, 1), (3, 4)]))
    assert frames.mask[:, :30].all() and frames.mask[:, 90:].all()
    assert not frames.mask[:, 30:90].any()
    torch.testing.assert_close(frames.value, dance.features())

    arms = known(Keep(dance, joints=["lelbow"]))
    j = dance.skeleton.index("lelbow")
    first = TCDIFFPP.rot6d.start + 6 * j
    assert arms.mask[..., first : first + 6].all() and arms.mask.sum() == 2 * 120 * 6

    one = known(Keep(dance, dancers=[1]))
    assert one.mask[1].all() and not one.mask[0].any()


def test_upper_and_lower_body_are_everything_but_contacts(dance):
    upper, lower = (known(Keep(dance, joints=f"{half} body")).mask for half in ("upper", "lower"))
    assert not (upper & lower).any()
    assert (upper | lower)[..., 4:].all() and not (upper | lower)[..., :4].any()
    assert lower[..., [X, Y, Z]].all() and not upper[..., [X, Y, Z]].any()


def test_a_longer_dance_is_kept_as_far_as_the_new_one_goes(dance):
    assert known(Keep(dance), frames=60).mask.shape == (2, 60, 151)
    longer = known(Keep(dance), frames=200)
    assert longer.mask[:, :120].all() and not longer.mask[:, 120:].any()


def test_combine_lets_the_same_thing_be_said_twice():
    start, path = StartAt([(-1, 0), (1, 0)]), WalkAlong(0, [(0, -1, 0), (2, 0, 0)])
    c = combine([start, path], 2, 120, 30.0)
    assert c.mask[0, :61, X].all() and c.mask[1, 0, X]
    with pytest.raises(ValueError, match="WalkAlong and an earlier one"):
        combine([start, WalkAlong(0, [(0, 1, 0), (2, 0, 0)])], 2, 120, 30.0)
    assert combine([], 2, 120, 30.0) is None


def test_normalized_scales_values_and_slack():
    norm = Normalizer(torch.full((151,), -1.0), torch.full((151,), 2.0))
    c = normalized(known(WalkAlong(0, [(0, 2, 0.5), (1, 2, 0.5)], slack=0.3)), norm)
    assert c.value[0, 0, [X, Z]].tolist() == [1.0, 0.0]
    assert c.slack[0, 0, X] == pytest.approx(0.2)


def test_numbers_and_orders_follow_from_places():
    c = combine([StartAt([(1, 0), (-1, 0), (0, 0)]), EndAt([(0, 0), (1, 0), (2, 0)])], 3, 90, 30.0)
    assert initial_order(c).tolist() == [1, 2, 0]
    assert final_order(c).tolist() == [0, 1, 2]
    some = combine([WalkAlong(0, [(0, 0, 0)]), WalkAlong(2, [(0, 1, 0)])], 3, 90, 30.0)
    assert initial_order(some) is None and final_order(some) is None
    wrong = combine([WalkAlong(0, [(0, 2, 0)]), WalkAlong(2, [(0, 1, 0)])], 3, 90, 30.0)
    with pytest.raises(ValueError, match="do not rise from left to right"):
        initial_order(wrong)


@pytest.mark.parametrize(
    ("control", "text"),
    [
        (StartAt([(0, 0)]), "start has 1 places for 2 dancers"),
        (EndAt([(0, 0, 0), (1, 1, 1)]), "end=.*2 finite numbers"),
        (EndAt("here"), "end='here'"),
        (StartAt([(0, float("nan")), (1, 0)]), "finite"),
        (WalkAlong(2, [(0, 0, 0)]), "dancer=2 must be a whole number in 0 ... 1"),
        (WalkAlong(1.0, [(0, 0, 0)]), "dancer=1.0 must be a whole number in 0 ... 1"),
        (WalkAlong(0, [(1, 0, 0), (1, 1, 1)]), "must rise"),
        (WalkAlong(0, [(0, 0, 0), (9, 1, 1)]), "at most 4 s"),
        (WalkAlong(0, [(1.01, 0, 0), (1.02, 1, 1)]), r"\[1.01, 1.02\]; no frame lies between"),
        (WalkAlong(0, [(0, 0, 0)], slack=-1), "slack=-1"),
        (StartAt([(0, 0), (2.9, -1)]), r"start has the place \(2.9, -1\), 3.1 m from the middle"),
        (EndAt([(0, 0), (0, 4)]), "end has .* within 3 m"),
        (WalkAlong(0, [(0, 0, 0), (1, -5, 0)]), "points has .*5.0 m"),
    ],
)
def test_errors(control, text):
    with pytest.raises(ValueError, match=text):
        known(control)


def test_errors_of_keep(dance):
    for options, text in (
        ({"joints": "arms"}, "'arms'"),
        ({"joints": ["larm"]}, "'larm'"),
        ({"dancers": [2]}, "dancer=2"),
        ({"seconds": (9, 10)}, "keeps nothing"),
        ({"seconds": 2}, r"seconds=2 must be \(from, to\)"),
        ({"seconds": []}, r"seconds=\[\] must be \(from, to\)"),
        ({"seconds": (-1, 2)}, "0 <= from < to"),
        ({"seconds": [(0, 1), (2, 2)]}, "0 <= from < to"),
    ):
        with pytest.raises(ValueError, match=text):
            known(Keep(dance, **options))
    with pytest.raises(ValueError, match=r"dance='a\.npz' is no Motion; give Motion\.load"):
        known(Keep("a.npz"))
    with pytest.raises(ValueError, match="constraints has 'start'"):
        combine(["start"], 2, 120, 30.0)


def test_a_dancer_may_be_a_number_of_numpy():
    path = [(0, 0, 1), (1, 1, 0)]
    assert torch.equal(known(WalkAlong(np.int64(1), path)).value, known(WalkAlong(1, path)).value)


@pytest.mark.parametrize(("control", "name"), [(StartAt, "start"), (EndAt, "end")])
def test_two_bodies_in_one_place_are_refused(control, name):
    with pytest.raises(ValueError, match=rf"{name} has dancers 1 and 2 0\.10 m apart"):
        known(control([(-1, 0), (0, 0), (0.1, 0)]), n=3)
    assert known(control([(0, 0), (0, 0.4)])).mask.any()


def held(*places, frames=150, guess=None):
    """What `NearbyFrames` asks of a guess, by default zeros, of a dancer given (frame, x)s."""
    mask = torch.zeros(1, frames, TCDIFFPP.dim, dtype=torch.bool)
    value = torch.zeros(mask.shape)
    for frame, x in places:
        mask[0, frame, X], value[0, frame, X] = True, x
    segment = Segment(0, 0, tuple(mask.shape), order=torch.arange(1), mask=mask)
    rule = NearbyFrames(Constraint(mask, value)).for_segment(segment)
    return rule.at(torch.zeros(mask.shape) if guess is None else guess, 0.5)


def test_frames_around_a_given_place_move_with_it():
    asked = held((0, 2.0))
    assert asked.mask[0, : HOLD + 1, X].all() and asked.mask.sum() == HOLD + 1
    assert (asked.value[0, : HOLD + 1, X] == 2).all()
    walk = torch.zeros(1, 150, TCDIFFPP.dim)
    walk[0, :, X] = 0.5 + 0.02 * torch.arange(150)
    near = slice(75 - HOLD, 75 + HOLD + 1)
    asked = held((75, 2.0), guess=walk).value[0, near, X]
    torch.testing.assert_close(asked, 2 + walk[0, near, X] - walk[0, 75, X])
    asked = held((0, 2.0), (60, -1.0))
    assert asked.value[0, :21, X].tolist() == [2.0] * 21
    assert asked.value[0, 40:81, X].tolist() == [-1.0] * 41, "up to a third of the way, both ways"
    assert not asked.mask[0, 21:40].any()
    assert held((5, 1.0), (6, 1.0)) is None, "a path is not held"
    asked = held((0, 2.0), (30, 1.0), (31, 1.0))
    assert asked.mask.sum() == 11, "nor are the frames before a path"
