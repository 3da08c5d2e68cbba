"""Lodge's numbered equations on two or three frames, worked out by hand."""

import math

import pytest
import torch

from dancediff.motion.representation import LODGE, Normalizer, joints_of
from dancediff.motion.rotation import matrix_to_rot6d, rotation_about
from dancediff.papers.lodge.cue_guidance import clean_borders, cue_channels
from dancediff.papers.lodge.losses import (
    LodgeWeights,
    l_contact,
    l_critic,
    l_genre,
    l_jacc,
    l_joint,
    l_jvel,
    l_recon,
    lodge_losses,
)

J = 24


def moved(**where):
    """Three frames of joints at the origin, but for joint 5: frame -> its position."""
    joints = torch.zeros(3, J, 3)
    for frame, position in where.items():
        joints[int(frame[1:]), 5] = torch.tensor(position)
    return joints


def test_lodge_eq02_recon():
    assert l_recon(torch.tensor([[4.0, 1.0]]), torch.tensor([[1.0, 1.0]])).item() == 4.5


def test_lodge_eq03_fk():
    x = torch.zeros(139)
    x[4:7] = torch.tensor([1.0, 2.0, 3.0])
    x[7:] = matrix_to_rot6d(torch.eye(3).expand(22, 3, 3)).flatten()
    upright = joints_of(x, LODGE)
    x[7:13] = matrix_to_rot6d(rotation_about("y", torch.tensor(math.pi)))
    turned = joints_of(x, LODGE)
    torch.testing.assert_close(upright[0], torch.tensor([1.0, 2.0, 3.0]))
    opposite = torch.tensor([-1.0, 1.0, -1.0]) * (upright - upright[0]) + upright[0]
    torch.testing.assert_close(turned, opposite, atol=1e-5, rtol=0)


def test_lodge_eq04_joint():
    truth = torch.randn(3, J, 3)
    error = l_joint(truth + moved(f1=[0.3, 0.0, 0.4]), truth)
    assert error.item() == pytest.approx(0.25 / (3 * J * 3), rel=1e-3)


def test_lodge_eq05_jvel():
    truth = torch.randn(3, J, 3)
    error = l_jvel(truth + moved(f1=[0.3, 0.0, 0.4]), truth)  # there and back
    assert error.item() == pytest.approx(2 * 0.25 * 30**2 / (2 * J * 3), rel=1e-3)


def test_lodge_eq06_jacc():
    truth = torch.randn(3, J, 3)
    error = l_jacc(truth + moved(f1=[0.3, 0.0, 0.4]), truth)
    assert error.item() == pytest.approx(4 * 0.25 * 30**4 / (1 * J * 3), rel=1e-3)


def test_lodge_eq07_contact():
    joints = torch.zeros(2, J, 3)
    joints[1, 7] = torch.tensor([0.1, 0.2, 0.0])  # slides and rises: only sliding counts
    joints[1, 11] = torch.tensor([0.0, -0.1, 0.2])  # slides and sinks: both count
    planted = torch.ones(2, 4)
    error = 30**2 * (0.1**2 + 0.1**2 + 0.2**2) / 12
    assert l_contact(joints, planted).item() == pytest.approx(error, rel=1e-5)
    assert l_contact(joints, 0.5 * planted).item() == pytest.approx(error / 4, rel=1e-5)


def test_lodge_eq08_sum():
    norm = Normalizer(-torch.ones(139), torch.ones(139))
    x, y = torch.randn(3, 139), torch.randn(3, 139)
    weights = LodgeWeights(
        recon=1, vel=0, foot=0, joint=2, jvel=3, jacc=4, contact=5, relative=False
    )
    t = lodge_losses(x, y, norm, weights=weights)
    total = t["recon"] + 2 * t["joint"] + 3 * t["jvel"] + 4 * t["jacc"] + 5 * t["contact"]
    torch.testing.assert_close(t["total"], total)
    guess, true = norm.unnormalize(x), norm.unnormalize(y)
    J, J_0 = joints_of(guess, LODGE), joints_of(true, LODGE)
    by_hand = l_recon(x, y) + 2 * l_joint(J, J_0) + 3 * l_jvel(J, J_0) + 4 * l_jacc(J, J_0)
    torch.testing.assert_close(total, by_hand + 5 * l_contact(J, guess[:, :4]))


def test_lodge_eq09_genre():
    """With probability D = 3/4 for the real and 1/4 for the made dance."""
    real, made = torch.tensor([math.log(3)]), torch.tensor([-math.log(3)])
    log_loss = -(math.log(0.75) + math.log(1 - 0.25))
    assert l_critic(real, made, form="log").item() == pytest.approx(log_loss)
    assert l_genre(made, form="log").item() == pytest.approx(-math.log(0.25))


def test_lodge_eq10_borders():
    x_t, x_0 = torch.randn(256, 139), torch.randn(256, 139)
    mixed, cued = clean_borders(x_t, x_0), cue_channels()
    assert torch.equal(mixed[:4, cued], x_0[:4, cued])
    assert torch.equal(mixed[-4:, cued], x_0[-4:, cued])
    assert torch.equal(mixed[4:-4], x_t[4:-4])
