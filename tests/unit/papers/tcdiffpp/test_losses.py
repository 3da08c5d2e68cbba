import pytest
import torch

from dancediff.motion.representation import Normalizer, pack
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.papers.tcdiffpp.losses import (
    LossWeights,
    l_contact,
    l_dist,
    l_fk,
    l_simple,
    l_vel,
    tcdiffpp_losses,
)


def motion(b=2, n=3, f=6, seed=0):
    g = torch.Generator().manual_seed(seed)
    pose = axis_angle_to_matrix(0.5 * torch.randn(b, n, f, 24, 3, generator=g))
    return pack(torch.rand(b, n, f, 4, generator=g), torch.randn(b, n, f, 3, generator=g), pose)


NORM = Normalizer(-2 * torch.ones(151), 3 * torch.ones(151))


def test_tcdiffpp_eq12_simple_is_the_mean_square():
    x, y = motion(seed=0), motion(seed=1)
    slow = sum((float(a) - float(b)) ** 2 for a, b in zip(x.flatten(), y.flatten(), strict=True))
    assert l_simple(x, y).item() == pytest.approx(slow / x.numel(), rel=1e-4)


def test_tcdiffpp_eq14_velocity_counts_the_root_but_not_contacts():
    x = torch.zeros(1, 1, 2, 151)
    y = x.clone()
    y[0, 0, 1, 5] = 1.0
    assert l_vel(y, x).item() == pytest.approx(1 / 147)
    y = x.clone()
    y[0, 0, 1, 2] = 1.0
    assert l_vel(y, x).item() == 0


def test_tcdiffpp_eq13_fk_by_hand():
    joints = torch.zeros(1, 1, 2, 24, 3)
    moved = joints.clone()
    moved[0, 0, 1, 7] = torch.tensor([0.3, 0.0, 0.4])
    assert l_fk(moved, joints).item() == pytest.approx(0.25 / (2 * 24 * 3))


def test_tcdiffpp_eq15_contact_by_hand():
    joints = torch.zeros(1, 1, 2, 24, 3)
    joints[0, 0, 1, 8] = torch.tensor([0.3, 0.0, 0.4])  # the right ankle moves half a metre
    claim = torch.zeros(1, 1, 2, 4)
    assert l_contact(joints, claim).item() == 0
    claim[0, 0, 0, 1] = 0.8
    assert l_contact(joints, claim).item() == pytest.approx(0.64 * 0.25 / 12)
    claim[0, 0, 0] = torch.tensor([1.0, 0.0, 1.0, 1.0])  # the other feet stand still
    assert l_contact(joints, claim).item() == 0


def test_tcdiffpp_eq17_distance_by_hand():
    root = torch.zeros(1, 3, 1, 3)
    moved = root.clone()
    moved[0, 1, 0, 0] = 0.6  # one of three moves: two of three pairs are wrong by 0.6 in x
    assert l_dist(moved, root).item() == pytest.approx(2 * 0.36 / 9)


def test_distance_is_blind_to_a_shift_of_the_group():
    root = torch.randn(2, 4, 9, 3)
    assert l_dist(root + torch.tensor([5.0, 0.0, -2.0]), root).item() < 1e-10
    root_bad = root.clone()
    root_bad[:, 2] += 0.5
    assert l_dist(root_bad, root).item() > 0.01


def test_a_solo_has_no_distance():
    root = torch.randn(2, 1, 5, 3, requires_grad=True)
    l_dist(root, torch.randn(2, 1, 5, 3)).backward()
    assert root.grad.eq(0).all()


def test_total_is_the_weighted_sum():
    x, y = motion(seed=0), motion(seed=1)
    weights = LossWeights(vel=0.5, dist=0.25)
    terms = tcdiffpp_losses(y, x, x, NORM, weights=weights)
    by_hand = sum(getattr(weights, k) * v for k, v in terms.items() if k != "total")
    assert torch.isclose(terms["total"], by_hand)


def test_a_perfect_guess_costs_only_its_own_sliding():
    x = motion()
    terms = tcdiffpp_losses(x, x, x, NORM)
    assert all(terms[k].item() < 1e-8 for k in ("simple", "vel", "fk", "dist"))


def test_gradients_are_finite_for_a_raw_network_output():
    y = torch.randn(1, 2, 5, 151, requires_grad=True)
    tcdiffpp_losses(y, y, motion(1, 2, 5), NORM)["total"].backward()
    assert y.grad.isfinite().all() and y.grad.abs().sum() > 0


def test_a_term_of_weight_zero_has_no_gradient():
    x, y = motion(seed=0), motion(seed=1).requires_grad_()
    none = {name: 0.0 for name in LossWeights().terms()}
    total = tcdiffpp_losses(y, y, x, NORM, weights=LossWeights(**none))["total"]
    assert total.item() == 0 and not total.requires_grad
    only_simple = LossWeights(**none | {"simple": 1.0})
    tcdiffpp_losses(y, x, x, NORM, weights=only_simple)["total"].backward()
    assert torch.allclose(y.grad, 2 * (y - x).detach() / x.numel(), atol=1e-9)


def test_both_outputs_learn():
    """The raw output has the reconstruction term alone, the adapted one all others."""
    x = motion(seed=0)
    raw, hat = motion(seed=1).requires_grad_(), motion(seed=2).requires_grad_()
    tcdiffpp_losses(raw, hat, x, NORM)["total"].backward()
    assert raw.grad.abs().sum() > 0 and hat.grad.abs().sum() > 0


def test_what_is_no_batch_of_groups_is_refused():
    """Frames would be taken for dancers, and one dancer for all."""
    norm = Normalizer(-torch.ones(151), torch.ones(151))
    x = torch.rand(1, 3, 8, 151)
    for truth, guess in ((x[0], x[0]), (x[:, :1], x)):
        with pytest.raises(ValueError, match=r"must all have one shape \(b, n, f, d\)"):
            tcdiffpp_losses(guess, guess, truth, norm)
