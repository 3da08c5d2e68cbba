from dataclasses import replace

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.metrics import corruption
from dancediff.metrics.corruption import (
    collapse,
    drag_feet,
    freeze,
    jitter,
    mean_pose,
    overlap_dancers,
    shift_beats,
    shuffle_time,
)  # fmt: skip

MOTIONS = [freeze, shuffle_time, drag_feet, overlap_dancers, jitter, mean_pose]
BEATS = np.arange(0.3, 6, 0.5)


@pytest.fixture(scope="module")
def dance():
    return choreograph(BEATS, dancers=3, seed=4, seconds=6)[0]


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("damage", MOTIONS)
def test_nothing_changes_at_amount_zero(damage, dance):
    out = damage(dance, 0.0, rng())
    assert torch.equal(out.pose, dance.pose) and torch.equal(out.root, dance.root)
    assert torch.equal(out.contact, dance.contact) and out.meta == dance.meta


@pytest.mark.parametrize("damage", MOTIONS)
@pytest.mark.parametrize("amount", [0.3, 1.0])
def test_the_result_is_a_motion_and_the_original_stays(damage, amount, dance):
    before = dance.pose.clone(), dance.root.clone()
    out = damage(dance, amount, rng())
    assert torch.equal(dance.pose, before[0]) and torch.equal(dance.root, before[1])
    assert out.root.shape == dance.root.shape and out.fps == dance.fps
    assert not (torch.equal(out.pose, dance.pose) and torch.equal(out.root, dance.root))
    eye = out.pose @ out.pose.mT
    assert torch.allclose(eye, torch.eye(3), atol=1e-4)
    again = damage(dance, amount, rng())
    assert torch.equal(out.pose, again.pose) and torch.equal(out.root, again.root)


@pytest.mark.parametrize("damage", [shuffle_time, drag_feet, jitter])
def test_another_seed_damages_otherwise(damage, dance):
    one, two = (damage(dance, 0.5, rng(k)).root for k in (0, 1))
    assert not torch.equal(one, two)


@pytest.mark.parametrize("damage", MOTIONS)
@pytest.mark.parametrize("amount", [-0.1, 1.01, float("nan")])
def test_an_amount_outside_is_refused(damage, amount, dance):
    with pytest.raises(ValueError, match="amount"):
        damage(dance, amount, rng())


def test_a_frozen_dance_stops(dance):
    root = freeze(dance, 0.75, rng()).root
    moving = root.diff(dim=1).norm(dim=-1).amax(0) > 0
    last = moving.nonzero().max().item() + 1
    assert last == pytest.approx(0.25 * dance.num_frames, abs=1)
    assert torch.equal(root[:, : last + 1], dance.root[:, : last + 1])
    assert torch.equal(freeze(dance, 1.0, rng()).root, dance.root[:, :1].expand_as(dance.root))


def test_shuffled_frames_are_the_same_frames(dance):
    x = torch.arange(float(dance.num_frames)).expand(3, -1)
    marked = replace(dance, root=x[..., None].repeat(1, 1, 3))
    half, whole = (shuffle_time(marked, a, rng()).root[0, :, 0] for a in (0.5, 1.0))
    for out in (half, whole):
        assert torch.equal(out.sort().values, x[0])
    pieces = dance.num_frames // 15
    assert (whole != x[0]).all()
    assert (half != x[0]).sum() == 15 * round(pieces / 2)
    changed = (half != x[0]).nonzero()[:, 0]
    assert changed.max() - changed.min() + 1 == len(changed)  # one stretch
    assert 2 <= (half.diff() != 1).sum() < (whole.diff() != 1).sum() < pieces
    assert (half.view(-1, 15).diff(dim=1) == 1).all()  # nothing is cut within a piece


def test_a_dance_too_short_to_shuffle_is_refused(dance):
    with pytest.raises(ValueError, match="15 frames"):
        shuffle_time(dance.frames(0, 15), 0.5, rng())


def test_dragged_feet_slide_and_nothing_else_changes(dance):
    for amount in (0.25, 1.0):
        out = drag_feet(dance, amount, rng())
        drift = out.root - dance.root
        assert torch.equal(out.pose, dance.pose)
        assert drift[..., 1].abs().max() == 0 and drift[:, 0].abs().max() == 0
        speed = drift.diff(dim=1).norm(dim=-1) * dance.fps
        assert speed.max() == pytest.approx(amount, rel=0.02)
    assert drift.norm(dim=-1).max() < 1.3


def test_overlap_scales_every_distance(dance):
    def apart(motion):
        floor = motion.root[..., (0, 2)].transpose(0, 1)
        return torch.stack(
            [(floor[:, i] - floor[:, j]).norm(dim=-1) for i, j in ((0, 1), (0, 2), (1, 2))]
        )

    out = overlap_dancers(dance, 0.75, rng())
    assert torch.allclose(apart(out), 0.25 * apart(dance), atol=1e-5)
    assert torch.equal(out.root[..., 1], dance.root[..., 1])
    assert apart(overlap_dancers(dance, 1.0, rng())).max() < 1e-6
    with pytest.raises(ValueError, match="1 dancer"):
        overlap_dancers(dance.dancer(0), 0.5, rng())


def test_jitter_has_the_stated_size(dance):
    for amount in (0.5, 1.0):
        out = jitter(dance, amount, rng())
        assert (out.root - dance.root).std().item() == pytest.approx(0.02 * amount, rel=0.05)
        turn = dance.pose.mT @ out.pose
        cos = (turn.diagonal(dim1=-2, dim2=-1).sum(-1) - 1) / 2
        angle = cos.double().clamp(-1, 1).acos()
        assert angle.square().mean().sqrt().item() == pytest.approx(
            amount * 0.15 * np.sqrt(3), rel=0.05
        )


def test_the_mean_pose_is_a_gliding_statue(dance):
    out = mean_pose(dance, 1.0, rng())
    assert out.pose.diff(dim=1).abs().max() < 1e-5
    assert out.root[..., 1].diff(dim=1).abs().max() < 1e-6
    assert torch.equal(out.root[..., (0, 2)], dance.root[..., (0, 2)])

    def spread(motion):
        return (motion.pose - out.pose).norm(dim=(-2, -1)).mean().item()

    spreads = [spread(mean_pose(dance, a, rng())) for a in (0.0, 0.5, 0.9)]
    assert spreads[1] == pytest.approx(spreads[0] / 2, rel=0.1)
    assert spreads[2] == pytest.approx(spreads[0] / 10, rel=0.1)


def test_a_collapsed_set_repeats_one_dance(dance):
    dances = [dance.frames(0, k) for k in (10, 20, 30, 40, 50)]
    assert all(a is b for a, b in zip(collapse(dances, 0.0, rng()), dances, strict=True))
    kinds = [len({id(d) for d in collapse(dances, a, rng())}) for a in (0.25, 0.5, 0.75, 1.0)]
    assert kinds == [4, 3, 2, 1]
    half = collapse(dances, 0.5, rng())
    changed = [k for k in range(5) if half[k] is not dances[k]]
    assert len(changed) == 2
    assert changed == [k for k in changed if collapse(dances, 0.75, rng())[k] is half[k]]
    with pytest.raises(ValueError, match="dances"):
        collapse(dances[:1], 0.5, rng())
    with pytest.raises(ValueError, match="amount"):
        collapse(dances, -1, rng())


def test_shifted_beats():
    assert np.array_equal(shift_beats(BEATS, 0.0, rng()), BEATS)
    for amount in (0.3, 1.0):
        moved = shift_beats(BEATS, amount, rng())
        assert (np.diff(moved) >= 0).all()
        assert 0.1 * amount < np.abs(moved - BEATS).max() <= 0.25 * amount + 1e-12
    with pytest.raises(ValueError, match="beats"):
        shift_beats([1.0], 0.5, rng())
    with pytest.raises(ValueError, match="amount"):
        shift_beats(BEATS, 2, rng())


def test_every_public_function_is_tested_here():
    public = {
        name for name, value in vars(corruption).items()
        if callable(value) and getattr(value, "__module__", "") == corruption.__name__
        and not name.startswith("_")
    }  # fmt: skip
    assert public == {f.__name__ for f in [*MOTIONS, collapse, shift_beats]}
