"""The losses of a training, against formulas written out here for the packaged recipes."""

from pathlib import Path

import pytest
import torch

from dancediff.extensions.both_guesses import both_guesses
from dancediff.extensions.slide_loss import slide_loss
from dancediff.motion.representation import LODGE, TCDIFFPP, Normalizer, pack
from dancediff.motion.rotation import axis_angle_to_matrix, rot6d_to_matrix
from dancediff.motion.skeleton import FOOT_JOINTS, forward_kinematics
from dancediff.nn.losses import compare
from dancediff.papers.lodge.losses import LodgeWeights, motion_losses
from dancediff.papers.tcdiffpp.losses import LossWeights, five_losses, tcdiffpp_losses
from dancediff.training.config import TrainingExtensions
from dancediff.training.extended_losses import extended_losses
from dancediff.training.lodge import check_lodge_tables, stage_config
from dancediff.training.run import check_tables, settings_of
from dancediff.training.tables import read_training

CONFIGS = Path(__file__).parents[3] / "configs"
NORM = Normalizer(-2 * torch.ones(151), 3 * torch.ones(151))
ROWS = torch.tensor([0.3, 1.9])


def motion(*shape, seed=0, joints=24):
    g = torch.Generator().manual_seed(seed)
    pose = axis_angle_to_matrix(0.5 * torch.randn(*shape, joints, 3, generator=g))
    contact, root = torch.rand(*shape, 4, generator=g), torch.randn(*shape, 3, generator=g)
    return (pack(contact, root, pose) - 0.5) / 2.5  # normalised


def physical(x):
    """Contacts, roots and joints of normalised motion with scales of -2 and 3."""
    y = 2.5 * x + 0.5
    rotations = rot6d_to_matrix(y[..., 7:].unflatten(-1, (-1, 6)))
    hands = torch.eye(3).expand(*rotations.shape[:-3], 24 - rotations.shape[-3], 3, 3)
    joints = forward_kinematics(torch.cat([rotations, hands], dim=-3), y[..., 4:7])
    return y[..., :4], y[..., 4:7], joints


def square(error, rows):
    """Mean square of each row of the batch, weighted."""
    return (rows * error.square().flatten(1).mean(1)).mean()


def group_total(x_raw, x_hat, x_0, rows, *, both, joint_velocity):
    (b, p, J), (b_0, p_0, J_0) = physical(x_hat), physical(x_0)
    feet = J[..., FOOT_JOINTS, :].diff(dim=2)
    simple = square(x_raw - x_0, rows)
    if both:
        simple = (simple + square(x_hat - x_0, rows)) / 2
    error = p - p_0
    pairs = [(i, j) for i in range(p.shape[1]) for j in range(i)]
    apart = [square(error[:, i] - error[:, j], rows) for i, j in pairs]
    return (
        0.636 * simple
        + 2.964 * square((x_hat - x_0)[..., 4:].diff(dim=2), rows)
        + 0.646 * square(J - J_0, rows)
        + 10.942 * square(feet * (b > 0.5)[:, :, :-1, :, None], rows)
        + (0.636 * sum(apart) / len(apart) if apart else 0)
        + joint_velocity * square(30 * (J - J_0).diff(dim=2), rows)
        + 0.1 * square(30 * feet * (b_0 > 0.5)[:, :, :-1, :, None], rows)
    )


@pytest.mark.parametrize(
    ("name", "dancers", "both", "joint_velocity"),
    [("tcdiffpp_small", 3, True, 0.5), ("edge_small", 1, False, 0.5)],
)
def test_groups_learn_by_what_the_recipe_says(name, dancers, both, joint_velocity):
    settings = settings_of(check_tables(read_training(CONFIGS / f"{name}.toml"), name))
    x_raw, x_hat, x_0 = (motion(2, dancers, 7, seed=k) for k in range(3))
    x_raw = x_raw if both else x_hat
    terms = extended_losses(
        compare(x_raw, x_hat, x_0, NORM),
        five_losses,
        settings.weights.terms(),
        extensions=settings.extensions,
        reconstruction="simple",
        row_weights=ROWS,
    )
    by_hand = group_total(x_raw, x_hat, x_0, ROWS, both=both, joint_velocity=joint_velocity)
    torch.testing.assert_close(terms["total"], by_hand)


@pytest.mark.parametrize("stage", ["global", "local", "fine_tune"])
def test_solos_learn_by_what_the_packaged_recipe_says(stage):
    tables = check_lodge_tables(read_training(CONFIGS / "lodge_small.toml"), "lodge_small")
    settings = stage_config(tables, stage)
    x_raw, x_hat, x_0 = (motion(2, 9, seed=k, joints=22) for k in range(3))
    terms = extended_losses(
        compare(x_raw, x_hat, x_0, Normalizer(-2 * torch.ones(139), 3 * torch.ones(139)), LODGE),
        lambda c: motion_losses(c, relative=settings.weights.relative),
        settings.weights.terms(),
        extensions=settings.extensions,
        reconstruction="recon",
        row_weights=ROWS,
    )

    (b, p, J), (b_0, p_0, J_0) = physical(x_hat), physical(x_0)
    feet = J[:, :, FOOT_JOINTS].diff(dim=1)
    place = J - J_0 if stage == "global" else (J - p[:, :, None]) - (J_0 - p_0[:, :, None])
    joint, foot = {"global": (0.636, 10.942), "local": (1, 20), "fine_tune": (1, 10)}[stage]
    planted = (b > 0.5)[:, :-1, :, None]
    total = (
        0.636 * (square(x_raw - x_0, ROWS) + square(x_hat - x_0, ROWS)) / 2
        + 2.964 * square((x_hat - x_0)[..., 4:].diff(dim=1), ROWS)
        + joint * square(place, ROWS)
        + foot * square(feet * planted, ROWS)
    )
    if stage != "global":
        total += 0.5 * square(30 * (J - J_0).diff(dim=1), ROWS)
        total += 0.1 * square(30 * feet * (b_0 > 0.5)[:, :-1, :, None], ROWS)
    if stage == "fine_tune":
        falls = torch.stack([feet[..., 0], feet[..., 1].clamp(max=0), feet[..., 2]], dim=-1)
        total += 0.05 * square(30 * (J - J_0).diff(n=2, dim=1), ROWS)
        total += 0.05 * square(30 * falls * planted, ROWS)
        total += 0.15 * square((p - p_0).diff(dim=1), ROWS)  # metres a frame, as in the code
        total += 0.3 * square((p - p_0).diff(n=2, dim=1), ROWS)
    torch.testing.assert_close(terms["total"], total)


def extended(x_raw, x_hat, x_0, rows=None, **extensions):
    return extended_losses(
        compare(x_raw, x_hat, x_0, NORM),
        five_losses,
        LossWeights().terms(),
        extensions=TrainingExtensions(**extensions),
        reconstruction="simple",
        row_weights=rows,
    )


def test_without_extensions_they_are_the_papers():
    x_raw, x_hat, x_0 = (motion(2, 3, 6, seed=k) for k in range(3))
    assert extended(x_raw, x_hat, x_0) == tcdiffpp_losses(x_raw, x_hat, x_0, NORM)


def test_a_term_of_weight_zero_is_not_computed():
    x = motion(1, 2, 6)
    assert "slide_loss" not in extended(x, x, x, joint_velocity_loss=0.2)
    assert "joint_velocity_loss" in extended(x, x, x, joint_velocity_loss=0.2)


def test_hard_contacts_cost_all_or_nothing():
    x, still = motion(1, 1, 6), motion(1, 1, 6)
    still[..., :4] = (0.4 - 0.5) / 2.5
    assert extended(still, still, x, hard_contact=True)["contact"] == 0
    assert extended(still, still, x)["contact"] > 0
    sure = still.clone()
    still[..., :4], sure[..., :4] = (0.6 - 0.5) / 2.5, (1 - 0.5) / 2.5
    hard, paper = (
        [extended(y, y, x, hard_contact=k)["contact"].item() for y in (still, sure)]
        for k in (True, False)
    )
    assert hard[0] == hard[1] == pytest.approx(paper[1]) and paper[0] < paper[1] / 2


def test_with_both_guesses_both_have_a_target():
    """The paper's reconstruction term is on the first guess alone."""
    x = motion(1, 2, 6)
    for weights in ({}, {"both_guesses": True}):
        raw, hat = (motion(1, 2, 6, seed=k).requires_grad_() for k in (1, 2))
        extended(raw, hat, x, **weights)["simple"].backward()
        assert raw.grad.abs().sum() > 0
        assert (hat.grad is not None) == bool(weights)


def test_of_one_guess_both_are_that_one():
    x, x_0 = motion(1, 2, 6, seed=1), motion(1, 2, 6)
    c = compare(x, x, x_0, NORM)
    assert both_guesses(c) == five_losses(c)["simple"]


def test_slide_uses_the_true_contacts():
    """A guess that denies its contacts escapes eq. 15; it does not escape the slide loss."""
    x = torch.zeros(1, 1, 4, 151)
    x[..., :4], x[..., 7:] = 1.0, torch.tensor([1.0, 0, 0, 0, 1, 0]).repeat(24)
    sliding = x.clone()
    sliding[..., 4] = torch.arange(4.0)
    sliding[..., :4] = 0.0
    norm = Normalizer(-torch.ones(151), torch.ones(151))
    c = compare(sliding, sliding, x, norm)
    assert five_losses(c)["contact"] == 0
    assert slide_loss(c).item() == pytest.approx(30**2 / 3, rel=1e-4)  # 1 m a frame, one axis of 3
    flying = x.clone()
    flying[..., :4] = 0.0
    assert slide_loss(compare(sliding, sliding, flying, norm)) == 0


@pytest.mark.parametrize(("spec", "shape"), [(TCDIFFPP, (2, 3, 6)), (LODGE, (2, 6))])
def test_a_row_of_weight_two_counts_twice_in_every_term(spec, shape):
    paper = {
        TCDIFFPP: five_losses,
        LODGE: lambda c: motion_losses(c, relative=True),
    }[spec]
    weights = {TCDIFFPP: LossWeights(), LODGE: LodgeWeights.fine_tune()}[spec].terms()
    norm = Normalizer(-2 * torch.ones(spec.dim), 3 * torch.ones(spec.dim))
    guesses = [motion(*shape, seed=k, joints=spec.num_joints) for k in range(3)]
    extensions = TrainingExtensions(
        joint_velocity_loss=0.1, slide_loss=0.1, both_guesses=True, hard_contact=True
    )

    def terms(part, rows=None):
        return extended_losses(
            compare(*(x[part] for x in guesses), norm, spec),
            paper,
            weights,
            extensions=extensions,
            reconstruction="simple" if spec is TCDIFFPP else "recon",
            row_weights=rows,
        )

    both = terms(slice(None), torch.tensor([2.0, 0.5]))
    first, second = terms(slice(0, 1)), terms(slice(1, 2))
    for name in both:
        assert both[name].item() == pytest.approx(
            (2 * first[name] + 0.5 * second[name]).item() / 2, rel=1e-4
        )
