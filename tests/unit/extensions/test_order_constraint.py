"""Order: who was asked to change places is helped there, and nobody else is moved."""

from dataclasses import replace

import pytest
import torch

import dancediff as dd
from dancediff.diffusion.long_sampling import Segment
from dancediff.extensions.collision_avoidance import SLACK
from dancediff.extensions.constraint import Constraint, ConstraintHook
from dancediff.extensions.order_constraint import (
    GAP,
    HOLD,
    START_GAP,
    OrderConstraint,
    X,
    in_order,
)
from dancediff.generation.pipeline import pipeline_of
from dancediff.motion.representation import Normalizer
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from tiny_tcdiffpp import tiny_tcdiffpp

F = 60


def ending_at(*places) -> torch.Tensor:
    """A guess whose dancers stand still at these x, metres (1, n, f, d)."""
    x = torch.zeros(1, len(places), F, 151)
    x[0, :, :, X] = torch.tensor(places, dtype=torch.float32)[:, None]
    return x


def ordered(x, abar, S, *before):
    norm = Normalizer(-torch.ones(151), torch.ones(151))
    std = 4.0 / (1 + torch.arange(F, dtype=torch.float32)[:, None]) ** 1.5
    sources = [*before, OrderConstraint(norm, torch.tensor(S))]
    return ConstraintHook(std.expand(F, 151), sources, as_linear=float).apply(x, abar)


def test_places_are_the_nearest_in_order():
    """Checked against many other places that are in order."""
    draw = torch.Generator().manual_seed(0)
    for S in torch.tensor([[0, 1, 2], [2, 0, 1], [1, 2, 0]]):
        x = torch.randn(3, generator=draw).double()
        y = in_order(x, S)
        assert y[S].diff().min() > GAP - 1e-9
        others = y[S] + 0.2 * torch.randn(2000, 3, generator=draw).double()
        others = others[(others.diff(dim=1) >= GAP).all(1)]
        assert len(others) > 50
        assert ((others - x[S]) ** 2).sum(1).min() > ((y - x) ** 2).sum()


def test_who_is_in_order_is_left_alone():
    x = ending_at(1.0, -1.0, 0.0)
    assert torch.equal(ordered(x, 0.5, [1, 2, 0]), x)


def test_a_noisy_guess_ends_in_order_and_its_path_turns_slowly():
    x = ending_at(-1.0, 1.0)
    conditioned = ordered(x, 0.3, [1, 0])
    ends = conditioned[0, :, -1, X]
    assert ends[0] - ends[1] > GAP - 2 * SLACK
    steps = conditioned[0, :, :, X].diff(dim=1)
    assert steps.abs().max() < 0.12, "nobody is pasted to the other side in a frame"
    others = [c for c in range(151) if c != X]
    assert torch.equal(conditioned[..., others], x[..., others])


def test_they_start_as_they_are_numbered_in_the_first_segment_only():
    norm, shape = Normalizer(-torch.ones(151), torch.ones(151)), (3, F, 151)
    S, given = torch.tensor([0, 2, 1]), torch.zeros(shape)
    first = Segment(0, 0, shape, order=torch.arange(3), mask=given, target=S)
    guess = ending_at(-1.0, 0.3, 0.2)[0]  # the second and the third stand in each other's place
    asked = OrderConstraint(norm).for_segment(first).at(guess, 0.5)
    assert asked.mask[:, : F // 3, X].all() and not asked.mask[:, F // 3 : F // 2].any()
    start = asked.value[:, 0, X]
    assert torch.allclose(start, torch.tensor([-1.0, 0.25 - START_GAP / 2, 0.25 + START_GAP / 2]))
    told = replace(first, mask=given.clone())
    told.mask[0, 0, X] = 1
    assert not OrderConstraint(norm).for_segment(told).starts, "the caller says where"
    later = replace(first, number=1, start=75, context=given[:, :10])
    asked = OrderConstraint(norm).for_segment(later).at(guess, 0.5)
    assert asked is None or not asked.mask[:, 0].any()


def test_the_order_is_held_in_the_last_frames_but_at_most_a_third():
    rule = OrderConstraint(Normalizer(-torch.ones(151), torch.ones(151)), torch.tensor([1, 0]))
    for frames, hold in ((150, HOLD), (60, 20)):
        guess = torch.zeros(2, frames, 151)
        guess[:, :, X] = torch.tensor([-1.0, 1.0])[:, None]
        asked = rule.at(guess, 0.5)
        assert asked.mask[:, -hold:, X].all() and asked.mask.sum() == 2 * hold
        held = asked.value[:, -hold:, X]
        assert (held[0] - held[1] - GAP).abs().max() < 1e-6


def test_metres_are_meant_whatever_the_training_range():
    norm = Normalizer(-2 * torch.ones(151), 3 * torch.ones(151))
    x = ending_at(-1.0, 1.0)[0]
    x[..., X] += torch.linspace(0, 0.3, F)  # they walk while they should change places
    asked = OrderConstraint(norm, torch.tensor([1, 0])).at(norm.normalize(x), 0.5)
    step = norm.unnormalize(asked.value) - x
    last = x[:, -1, X] + step[:, -1, X]
    assert (last[0] - last[1]).item() == pytest.approx(GAP, abs=1e-5)
    same = step[:, -1:, X].expand(-1, 20)
    torch.testing.assert_close(step[:, -20:, X], same, atol=1e-5, rtol=0)
    torch.testing.assert_close(asked.slack, torch.full_like(x, SLACK / 2.5))


def test_pure_noise_and_a_sure_guess_are_not_moved():
    x = ending_at(-1.0, 1.0)
    assert torch.equal(ordered(x, 0.01, [1, 0]), x)
    assert (ordered(x, 1 - 1e-7, [1, 0]) - x).abs().max() < SLACK


def test_what_is_told_is_kept():
    x = ending_at(-1.0, 1.0)
    mask = torch.zeros_like(x[0], dtype=torch.bool)
    mask[0, :, X] = True  # the left one may not move
    conditioned = ordered(x, 0.3, [1, 0], Constraint(mask, x[0].clone()))
    assert torch.allclose(conditioned[0, 0], x[0, 0], atol=1e-3)
    assert conditioned[0, 1, -1, X] < x[0, 1, -1, X] - 0.5


def test_arguments():
    song, model = dd.packaged_song(), tiny_tcdiffpp()
    with pytest.raises(ValueError, match="order_constraint='sorted' must be True or False"):
        model.generate(song, order_constraint="sorted")
    plain = TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32))
    with pytest.raises(ValueError, match="order_constraint=True needs"):
        pipeline_of(plain).generate(song, order_constraint=True)
    with pytest.raises(ValueError, match="order_constraint=True is not possible"):
        model.generate(song, long_sampling="naive", order_constraint=True)
    assert model.generate(song, seconds=5, steps=1).meta["order_constraint"] is True


def test_an_order_is_asked_of_the_rows_that_dancers_have_in_a_segment():
    norm, shape = Normalizer(-torch.ones(151), torch.ones(151)), (3, F, 151)
    segment = Segment(1, 75, shape, order=torch.tensor([2, 0, 1]), mask=torch.zeros(shape))
    rule = OrderConstraint(norm)
    assert rule.for_segment(segment) is None
    asked = rule.for_segment(replace(segment, target=torch.tensor([1, 2, 0])))
    rows = asked.at(ending_at(0.0, 0.0, 0.0)[0], 0.5).value[:, -1, X]
    assert segment.order[rows.argsort()].tolist() == [1, 2, 0]
