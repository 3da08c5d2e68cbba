"""Equations of both papers that no other file has a test of this name for."""

import torch

from dancediff.data.windows import rank_left_to_right
from dancediff.diffusion.schedule import cosine_abar, q_sample
from dancediff.motion.order import left_to_right
from dancediff.motion.representation import TCDIFFPP
from dancediff.motion.skeleton import LOWER_BODY
from dancediff.nn.ssm import selective_scan_ref
from dancediff.papers.tcdiffpp.footwork_adaptor import FootworkAdaptor, ground_velocity
from dancediff.papers.tcdiffpp.group_dance_decoder import DancerPositioning

A, B, C = torch.tensor([[-0.7, -3.0]]), torch.tensor([1.5, 0.4]), torch.tensor([0.8, -1.1])
X = TCDIFFPP.root.start


def scan(u, delta):
    """One channel, two states, constant A, B, C: (f,) -> (f,)."""
    f = len(u)
    frames = {"B": B.expand(1, f, 2), "C": C.expand(1, f, 2)}
    step = torch.full((1, f, 1), delta)
    return selective_scan_ref(u[None, :, None], step, A, D_skip=torch.zeros(1), **frames)[0, :, 0]


def random_group(n=4, f=12):
    return torch.randn(n, f, TCDIFFPP.dim, generator=torch.Generator().manual_seed(0))


def test_tcdiffpp_eq03_the_scan_solves_the_differential_equation():
    """h' = A h + B x, y = C h for a constant x has a closed form; short steps come near to it."""
    end, x = 2.0, 1.3
    exact = (C * (B * x / A[0]) * ((A[0] * end).exp() - 1)).sum()
    off = []
    for steps in (200, 2000):
        y = scan(torch.full((steps,), x), end / steps)
        off.append((y[-1] - exact).abs() / exact.abs())
    assert off[0] < 0.05 and off[1] < 0.005


def test_tcdiffpp_eq04_with_fixed_parameters_the_scan_is_a_convolution():
    u = torch.randn(30, generator=torch.Generator().manual_seed(0))
    k = torch.arange(30)[:, None]
    kernel = (C * (0.1 * A[0]).exp() ** k * 0.1 * B).sum(-1)  # B discretised as Delta B
    y = torch.stack([(kernel[: f + 1].flip(0) * u[: f + 1]).sum() for f in range(30)])
    torch.testing.assert_close(scan(u, 0.1), y)


def test_tcdiffpp_eq05_sigma_is_the_argsort_of_lateral_positions():
    p = torch.tensor([0.3, -2.0, 1.1, -0.4])
    assert left_to_right(p).tolist() == [1, 3, 0, 2]


def test_tcdiffpp_eq06_positions_rise_along_sigma():
    p = torch.randn(50, 5, generator=torch.Generator().manual_seed(0))
    assert (p.gather(1, left_to_right(p)).diff(dim=1) >= 0).all()


def test_tcdiffpp_eq07_the_sequences_are_reordered_as_a_whole():
    x = random_group()
    ranked, _ = rank_left_to_right(x)
    sigma = left_to_right(x[:, 0, X])
    assert torch.equal(ranked, x[sigma])
    assert (ranked[:, 0, X].diff() >= 0).all()


def test_tcdiffpp_eq08_one_vector_a_rank_is_added_in_all_frames():
    dpe, h = DancerPositioning(5, 8), torch.randn(2, 3, 7, 8)
    added = dpe(h) - h
    torch.testing.assert_close(added, dpe.table[:3, None].expand(2, 3, 7, 8))


def test_tcdiffpp_eq09_velocity_is_the_difference_of_neighbouring_frames():
    x = 0.01 * random_group()[None]
    v = ground_velocity(x)
    p = x[..., [X, X + 2]]  # over the floor
    torch.testing.assert_close(v[:, :, 1:] / 30, p[:, :, 1:] - p[:, :, :-1])
    assert not v[:, :, 0].any()


def test_tcdiffpp_eq10_the_adaptor_reads_motion_and_velocity():
    torch.manual_seed(0)
    fa = FootworkAdaptor()
    for weights in fa.parameters():
        torch.nn.init.normal_(weights, std=0.2)
    x = 0.1 * random_group()[None]
    v = ground_velocity(x)
    with torch.no_grad():
        usual, other = fa.adapt(x, v), fa.adapt(x.flip(1), v.flip(1))
        without = fa.adapt(x, 0 * v)
    torch.testing.assert_close(other, usual.flip(1))  # each dancer alone
    assert (usual - without)[:, :, 1:].abs().max() > 1e-3
    torch.testing.assert_close(usual[:, :, 0], without[:, :, 0])  # frame 0 has no velocity
    h = x
    for k, layer in enumerate(fa.layers):  # all three are told
        h = layer.linear(h) * torch.sigmoid(layer.gate(v)) + layer.shift(v)
        h = h if k == 2 else torch.nn.functional.leaky_relu(h)
    torch.testing.assert_close(usual, h)


def test_tcdiffpp_eq11_legs_of_the_adapted_and_the_rest_of_the_raw_motion():
    torch.manual_seed(0)
    fa, x = FootworkAdaptor(), random_group()[None]
    v = ground_velocity(x)
    with torch.no_grad():
        out, adapted = fa(x, v), fa.adapt(x, v)
    legs = TCDIFFPP.joint_channels(LOWER_BODY)
    rest = [c for c in range(TCDIFFPP.dim) if c not in legs]
    assert torch.equal(out[..., legs], adapted[..., legs])
    assert torch.equal(out[..., rest], x[..., rest])
    assert not torch.equal(adapted[..., rest], x[..., rest])


def test_lodge_eq01_noisy_dances_have_the_mean_and_variance_of_the_equation():
    draw = torch.Generator().manual_seed(0)
    abar, d_0 = cosine_abar(), torch.tensor([1.5, -0.5, 0.0])
    for t in (50, 500, 900):
        eps = torch.randn(200_000, 3, generator=draw)
        d_t = q_sample(d_0.expand_as(eps), t, abar, eps)
        torch.testing.assert_close(d_t.mean(0), (abar[t].sqrt() * d_0).float(), atol=0.01, rtol=0)
        torch.testing.assert_close(d_t.var(0), (1 - abar[t]).float().expand(3), atol=0.01, rtol=0)
