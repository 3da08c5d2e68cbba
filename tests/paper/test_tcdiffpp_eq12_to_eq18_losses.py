"""The losses of TCDiff++ section 4.3, each against the paper's sums written out as loops.

The paper's bars are sums of squares over one clip; ours are means. Each test says by which factor.
"""

import math

import pytest
import torch

from dancediff.motion.representation import Normalizer, pack, unpack
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import FOOT_JOINTS, SMPL24, forward_kinematics
from dancediff.papers.tcdiffpp.losses import (
    l_contact,
    l_dist,
    l_fk,
    l_simple,
    l_vel,
    tcdiffpp_losses,
)

B, N, F = 2, 3, 4


def group(seed):
    g = torch.Generator().manual_seed(seed)
    pose = axis_angle_to_matrix(0.5 * torch.randn(B, N, F, 24, 3, generator=g))
    contact = torch.rand(B, N, F, 4, generator=g)
    return pack(contact, torch.randn(B, N, F, 3, generator=g), pose).double()


@pytest.fixture
def clips():
    return group(0), group(1)


def square(vector):
    return sum(float(v) ** 2 for v in vector.flatten())


def fk_by_hand(x):
    """Joint by joint, frame by frame; p_j = p_parent + Q_parent offset_j."""
    _, root, pose = unpack(x)
    joints = torch.zeros(*x.shape[:-1], 24, 3, dtype=x.dtype)
    for index in torch.cartesian_prod(*(torch.arange(k) for k in x.shape[:-1])).tolist():
        where, Q = tuple(index), {}
        for j, parent in enumerate(SMPL24.parents):
            R = pose[where][j]
            if parent < 0:
                Q[j], joints[where][j] = R, root[where]
            else:
                Q[j] = Q[parent] @ R
                step = Q[parent] @ SMPL24.offsets[j].to(x)
                joints[where][j] = joints[where][parent] + step
    return joints


def test_tcdiffpp_eq12_simple(clips):
    x_0, x_hat = clips
    paper = sum(square(x_0[b] - x_hat[b]) for b in range(B)) / B  # the expectation
    assert l_simple(x_hat, x_0).item() == pytest.approx(paper / (N * F * 151))


def test_tcdiffpp_eq13_forward_kinematics(clips):
    x_0, x_hat = clips
    a, b = fk_by_hand(x_0), fk_by_hand(x_hat)
    paper = sum(square(a[:, :, i] - b[:, :, i]) for i in range(F)) / F
    ours = l_fk(*(forward_kinematics(*unpack(x)[:0:-1]) for x in (x_hat, x_0)))
    assert ours.item() == pytest.approx(paper / (B * N * 24 * 3), rel=1e-6)


def test_tcdiffpp_eq14_velocity(clips):
    x_0, x_hat = (x[..., 4:] for x in clips)  # contacts have no velocity
    paper = 0.0
    for i in range(F - 1):
        true = x_0[:, :, i + 1] - x_0[:, :, i]
        paper += square(true - (x_hat[:, :, i + 1] - x_hat[:, :, i])) / (F - 1)
    assert l_vel(clips[1], clips[0]).item() == pytest.approx(paper / (B * N * 147))


def test_tcdiffpp_eq15_contact(clips):
    x_hat = clips[1]
    joints, label, paper = fk_by_hand(x_hat), x_hat[..., :4], 0.0
    for b, n, i in torch.cartesian_prod(torch.arange(B), torch.arange(N), torch.arange(F - 1)):
        for k, foot in enumerate(FOOT_JOINTS):
            moved = joints[b, n, i + 1, foot] - joints[b, n, i, foot]
            paper += square(moved * float(label[b, n, i, k])) / (F - 1)
    assert l_contact(joints, label).item() == pytest.approx(paper / (B * N * 4 * 3))


def test_tcdiffpp_eq15_label_is_that_of_the_earlier_frame():
    joints = torch.zeros(1, 1, 2, 24, 3)
    joints[0, 0, 1, 7] = 1.0
    label = torch.zeros(1, 1, 2, 4)
    label[0, 0, 1, 0] = 1.0  # planted only once it has arrived
    assert l_contact(joints, label).item() == 0
    label[0, 0, 0, 0] = 1.0
    assert l_contact(joints, label).item() > 0


def test_tcdiffpp_eq16_and_eq17_distance(clips):
    p, p_hat = (x[..., 4:7] for x in clips)
    total = 0.0
    for b in range(B):
        for w in range(F):
            for i in range(N):
                for j in range(i + 1, N):
                    true = p[b, i, w] - p[b, j, w]
                    total += square(true - (p_hat[b, i, w] - p_hat[b, j, w]))  # eq. 16
    # eq. 17 divides the sum by C - 1; a mean divides it by batch, frames, pairs and 3 axes
    paper = total / (N - 1)
    ours = paper * (N - 1) / (B * F * math.comb(N, 2) * 3)
    assert l_dist(p_hat, p).item() == pytest.approx(ours)


def test_tcdiffpp_eq17_is_zero_iff_all_offsets_match():
    p = torch.randn(1, 4, 6, 3)
    wandering = torch.randn(1, 1, 6, 3)  # the whole group, another way in every frame
    assert l_dist(p + wandering, p).item() < 1e-10
    for dancer in range(4):
        wrong = p.clone()
        wrong[:, dancer, 3, 2] += 0.1
        assert l_dist(wrong, p).item() > 1e-5


def test_tcdiffpp_eq18_sum_with_the_weights_of_section_5_1(clips):
    x_0, x_hat = (x.float() for x in clips)
    x_raw = group(2).float()
    norm = Normalizer(-2 * torch.ones(151), 3 * torch.ones(151))
    true, guess = norm.unnormalize(x_0), norm.unnormalize(x_hat)
    joints, joints_0 = fk_by_hand(guess), fk_by_hand(true)
    by_hand = (
        0.636 * l_simple(x_raw, x_0)
        + 0.646 * l_fk(joints, joints_0)
        + 2.964 * l_vel(x_hat, x_0)
        + 10.942 * l_contact(joints, guess[..., :4])
        + 0.636 * l_dist(guess[..., 4:7], true[..., 4:7])
    )
    ours = tcdiffpp_losses(x_raw, x_hat, x_0, norm)["total"]
    assert ours.item() == pytest.approx(by_hand.item(), rel=1e-4)
