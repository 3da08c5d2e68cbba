"""Collision avoidance: who would run into somebody is asked to make room, and nobody else."""

import pytest
import torch

import dancediff as dd
from dancediff.extensions.collision_avoidance import (
    EVERY,
    ROOM,
    SLACK,
    CollisionAvoidance,
    X,
    Z,
    girths,
    pushes,
)
from dancediff.extensions.constraint import Constraint, ConstraintHook
from dancediff.generation.pipeline import pipeline_of
from dancediff.motion.representation import Normalizer, pack
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from tiny_tcdiffpp import tiny_tcdiffpp

F = 30


def standing(*places) -> torch.Tensor:
    """Dancers in the rest pose at (x, z), metres (n, f, 151)."""
    root = torch.tensor([[x, 0.95, z] for x, z in places], dtype=torch.float32)
    root = root[:, None].expand(-1, F, -1)
    n = len(places)
    return pack(torch.ones(n, F, 4), root, torch.eye(3).expand(n, F, 24, 3, 3))


def joints(x):
    return dd.Motion.from_features(x).joints()


def spaced(x, abar, *before):
    norm = Normalizer(-torch.ones(151), torch.ones(151))
    std = 4.0 / (1 + torch.arange(F, dtype=torch.float32)[:, None]) ** 1.5
    sources = [*before, CollisionAvoidance(norm)]
    return ConstraintHook(std.expand(F, 151), sources, as_linear=float).apply(x, abar)


def gap(x):
    """Between the nearest joints of two dancers, less their girths."""
    a, b = joints(x)
    size = girths()
    return (torch.cdist(a, b) - size[:, None] - size).amin().item()


def test_girths_are_those_of_the_bodies_that_collide():
    size = girths()
    assert size.min() == pytest.approx(0.03) and size.max() == pytest.approx(0.12)


def test_who_has_room_is_left_alone():
    x = standing((-1.5, 0), (1.5, 0))
    assert not pushes(joints(x)).any()
    assert torch.equal(spaced(x[None], 0.5), x[None])


def test_both_step_aside_by_half_of_what_is_lacking():
    x = standing((-0.75, 0), (0.75, 0.2))  # arms stretched out to the sides
    push = pushes(joints(x))
    assert torch.allclose(push[0], -push[1])
    apart = torch.tensor([-1.5, -0.2]) / torch.tensor([-1.5, -0.2]).norm()
    lack = ROOM - gap(x)
    assert torch.allclose(push[0], apart * lack / 2, atol=1e-5)


def test_who_passes_by_steps_across_not_back():
    w = torch.linspace(-1, 1, F)
    x = standing((0, 0), (0, 0.1))
    x[0, :, X], x[1, :, X] = 2 * w, -2 * w  # at 4 m/s past each other, nearly in one line
    push = pushes(joints(x))
    middle = push[:, F // 2]
    assert middle[0, 1] < 0 < middle[1, 1], "the one in front steps forward, the other back"
    assert middle[:, 0].abs().max() < 0.05 * middle[:, 1].abs().max()


def test_a_noisy_guess_is_moved_as_a_whole_and_a_sure_one_not():
    x = standing((-0.8, 0), (0.8, 0))[None]
    early, late = spaced(x, 0.3), spaced(x, 1 - 1e-7)
    assert gap(early[0]) > gap(x[0]) + 0.5 * (ROOM - gap(x[0]))
    step = early[0, :, :, X] - x[0, :, :, X]
    assert step.std(dim=1).max() < 0.1 * step.abs().min(), "it is one step aside, not a wobble"
    others = [c for c in range(151) if c not in (X, Z)]
    assert torch.equal(early[..., others], x[..., others])
    assert (late - x).abs().max() < SLACK / 10


def test_metres_are_meant_whatever_the_training_range():
    norm = Normalizer(-2 * torch.ones(151), 3 * torch.ones(151))
    x = standing((-0.65, 0), (0.65, 0.2))
    x[0, :, X] += torch.linspace(0, 0.15, F)  # towards the other, but too slowly to pass by
    asked = CollisionAvoidance(norm).at(norm.normalize(x), 0.5)
    step = (norm.unnormalize(asked.value) - x)[:, ::EVERY]
    push = pushes(joints(x)[:, ::EVERY], fps=30 / EVERY)
    assert push.abs().amin((0, 1)).min() > 0.002, "along both axes, in every frame"
    torch.testing.assert_close(step[..., [X, Z]], push, atol=1e-5, rtol=0)
    torch.testing.assert_close(asked.slack, torch.full_like(x, SLACK / 2.5))


def test_what_is_told_is_kept():
    x = standing((-0.8, 0), (0.8, 0))
    mask = torch.zeros_like(x, dtype=torch.bool)
    mask[0, :, [X, Z]] = True  # the left one may not move
    conditioned = spaced(x[None], 0.3, Constraint(mask, x.clone()))[0]
    assert torch.allclose(conditioned[0], x[0], atol=1e-4)
    assert conditioned[1, :, X].mean() > x[1, :, X].mean() + 0.02


def test_arguments():
    song, model = dd.packaged_song(), tiny_tcdiffpp()
    with pytest.raises(ValueError, match="collision_avoidance='wide' must be True or False"):
        model.generate(song, collision_avoidance="wide")
    plain = TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32))
    with pytest.raises(ValueError, match="collision_avoidance=True needs"):
        pipeline_of(plain).generate(song, collision_avoidance=True)


def test_naive_sampling_keeps_nobody_apart_and_says_so():
    song, model = dd.packaged_song(), tiny_tcdiffpp()
    naive = {"long_sampling": "naive", "seconds": 5, "steps": 2}
    with pytest.raises(ValueError, match="not possible with long_sampling='naive'"):
        model.generate(song, collision_avoidance=True, **naive)
    assert model.generate(song, **naive).meta["collision_avoidance"] is False


def test_room_is_kept_where_the_model_can():
    song, model = dd.packaged_song(), tiny_tcdiffpp()
    plain = TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32))
    ask = {"seconds": 5, "steps": 1}
    models = (model, pipeline_of(plain))
    made = [m.generate(song, **ask).meta["collision_avoidance"] for m in models]
    assert made == [True, False]
