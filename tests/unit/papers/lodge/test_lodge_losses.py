import pytest
import torch

from dancediff.motion.representation import Normalizer, pack
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.papers.lodge.losses import (
    LodgeWeights,
    l_contact,
    l_critic,
    l_diversity,
    l_focus,
    l_foot,
    l_genre,
    l_joint,
    l_vel,
    lodge_losses,
)

NORM = Normalizer(-2 * torch.ones(139), 3 * torch.ones(139))


def motion(*shape, seed=0):
    g = torch.Generator().manual_seed(seed)
    pose = axis_angle_to_matrix(0.5 * torch.randn(*shape, 22, 3, generator=g))
    return pack(torch.rand(*shape, 4, generator=g), torch.randn(*shape, 3, generator=g), pose)


def test_truth_costs_nothing_but_its_own_sliding_feet():
    x = NORM.normalize(motion(2, 9))
    terms = lodge_losses(x, x, NORM, weights=LodgeWeights.fine_tune())
    assert all(terms[name] == 0 for name in terms.keys() - {"foot", "contact", "total"})


@pytest.mark.parametrize("kind", ["coarse", "local", "fine_tune"])
def test_total_is_the_weighted_sum(kind):
    weights = getattr(LodgeWeights, kind)()
    x, y = (NORM.normalize(motion(2, 9, seed=k)) for k in (0, 1))
    terms = lodge_losses(x, y, NORM, weights=weights)
    total = sum(weights.terms()[name] * terms[name] for name in weights.terms())
    torch.testing.assert_close(terms["total"], total)
    assert terms.keys() == weights.terms().keys() | {"total"}


def test_every_weighted_term_teaches():
    for kind in ("coarse", "local", "fine_tune"):
        weights = getattr(LodgeWeights, kind)()
        for name in (name for name, weight in weights.terms().items() if weight):
            only = {other: 0.0 for other in weights.terms()} | {name: 1.0}
            x = NORM.normalize(motion(2, 9)).requires_grad_()
            target = NORM.normalize(motion(2, 9, seed=1))
            alone = getattr(LodgeWeights, kind)(**only)
            lodge_losses(x, target, NORM, weights=alone)["total"].backward()
            assert x.grad.isfinite().all() and x.grad.abs().max() > 0, (kind, name)


def test_primitives_are_not_compared_across_the_gaps():
    x = NORM.normalize(motion(2, 13, 8))
    moved = x.clone()
    moved[:, 1:, :, 4] += 0.5  # whole primitives stand elsewhere: no velocity is wrong
    weights = LodgeWeights.coarse()
    apart = lodge_losses(moved, x, NORM, weights=weights)
    together = lodge_losses(moved.flatten(1, 2), x.flatten(1, 2), NORM, weights=weights)
    assert apart["vel"] < 1e-12 and together["vel"] > 1e-6


def test_relative_joints_do_not_ask_where_the_dancer_stands():
    x = NORM.normalize(motion(2, 9))
    moved = x.clone()
    moved[..., 4] += 0.5
    for relative in (True, False):
        weights = LodgeWeights.local(relative=relative)
        joint = lodge_losses(moved, x, NORM, weights=weights)["joint"]
        assert (joint < 1e-10) == relative


def test_hinge_stops_where_the_verdict_is_clear():
    sure = torch.tensor([2.0, 5.0])
    assert l_critic(sure, -sure).item() == 0
    assert l_critic(torch.zeros(2), torch.zeros(2)).item() == 1
    assert l_critic(-sure, sure).item() == pytest.approx(4.5)


def test_generator_wants_what_the_critic_does_not():
    for form in ("hinge", "log"):
        made = torch.zeros(3, requires_grad=True)
        (up,) = torch.autograd.grad(l_critic(torch.zeros(3), made, form=form), made)
        (down,) = torch.autograd.grad(l_genre(made, form=form), made)
        assert (up > 0).all() and (down < 0).all()
    with pytest.raises(ValueError, match="form='wgan'"):
        l_genre(made, form="wgan")
    with pytest.raises(ValueError, match="form='wgan'"):
        l_critic(made, made, form="wgan")


def test_diversity_rewards_other_styles_for_other_noise():
    z_a, z_b, s = torch.randn(4, 8), torch.randn(4, 8), torch.randn(4, 16)
    near, far = l_diversity(z_a, z_b, s, s + 0.1), l_diversity(z_a, z_b, s, s + 1)
    assert far < near and l_diversity(z_a, z_b, s, s).isfinite()


def test_focus_likes_the_genre_and_no_other():
    made, other = torch.zeros(2, requires_grad=True), torch.zeros(2, requires_grad=True)
    l_focus(made, other).backward()
    assert (made.grad < 0).all() and (other.grad > 0).all()


def test_contact_is_that_of_the_frame_that_a_foot_leaves():
    joints, contact = torch.zeros(2, 24, 3), torch.zeros(2, 4)
    joints[1, 7, 0] = 1.0  # the left ankle slides
    for loss in (l_foot, l_contact):
        late, soon = contact.clone(), contact.clone()
        late[1, 0], soon[0, 0] = 1.0, 1.0
        assert loss(joints, late) == 0 and loss(joints, soon) > 0


def test_contacts_have_no_velocity():
    x = torch.zeros(2, 3, 139)
    flickers = x.clone()
    flickers[:, 1, :4] = 1
    assert l_vel(flickers, x) == 0
    flickers[:, 1, 4] = 1
    assert l_vel(flickers, x) > 0


def test_relative_joints_are_seen_from_the_root():
    joints = torch.randn(3, 24, 3)
    hand = joints.clone()
    hand[:, 23] += 1
    torch.testing.assert_close(l_joint(hand, joints, relative=True), l_joint(hand, joints))
