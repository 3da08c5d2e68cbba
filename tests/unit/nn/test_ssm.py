import copy
from functools import partial

import pytest
import torch

from dancediff.extensions.ssd import SSDBlock, segsum, ssd_scan, ssd_scan_ref
from dancediff.nn.ssm import MambaBlock, init_delta, selective_scan, selective_scan_ref

BLOCKS = pytest.mark.parametrize("make", [MambaBlock, partial(SSDBlock, head_dim=8)])


def scan_inputs(b, f, d, s, dtype=torch.float64):
    torch.manual_seed(0)
    u, B, C = (torch.randn(b, f, k, dtype=dtype) for k in (d, s, s))
    delta, A = torch.rand(b, f, d, dtype=dtype), -2 * torch.rand(d, s, dtype=dtype)
    return [x.requires_grad_() for x in (u, delta, A, B, C, torch.randn(d, dtype=dtype))]


def ssd_inputs(b, f, h, p, s, dtype=torch.float64):
    torch.manual_seed(0)
    u, delta = torch.randn(b, f, h * p, dtype=dtype), torch.rand(b, f, h, dtype=dtype)
    B, C = torch.randn(b, f, s, dtype=dtype), torch.randn(b, f, s, dtype=dtype)
    A, D = -2 * torch.rand(h, dtype=dtype), torch.randn(h, dtype=dtype)
    return [x.requires_grad_() for x in (u, delta, A, B, C, D)]


def assert_same_value_and_gradient(fast, slow, inputs, *, tol):
    y, y_ref = fast(*inputs), slow(*inputs)
    torch.testing.assert_close(y, y_ref, atol=tol, rtol=tol)
    weight = torch.randn_like(y)
    grads = torch.autograd.grad((y * weight).sum(), inputs)
    grads_ref = torch.autograd.grad((y_ref * weight).sum(), inputs)
    for grad, grad_ref in zip(grads, grads_ref, strict=True):
        scale = 1 + grad_ref.abs().max().item()
        torch.testing.assert_close(grad, grad_ref, atol=tol * scale, rtol=tol)


def test_ref_by_hand():
    """Two frames, one channel, two states, worked out on paper."""
    u, delta = torch.tensor([[[2.0], [3.0]]]), torch.tensor([[[1.0], [0.5]]])
    A = torch.tensor([[-1.0, -2.0]])
    B, C = torch.tensor([[[1.0, 1.0], [2.0, 0.0]]]), torch.tensor([[[1.0, 0.0], [1.0, 1.0]]])
    y = selective_scan_ref(u, delta, A, B, C, torch.tensor([10.0]))
    e = torch.tensor(1.0).exp()
    # state 0: (2, 2); state 1: (2 e^-.5 + .5*2*3, 2 e^-1 + 0)
    expected = torch.stack([2.0 + 20 + 0 * e, 2 * e**-0.5 + 3 + 2 / e + 30])
    torch.testing.assert_close(y.flatten(), expected)


@pytest.mark.parametrize("f", [1, 2, 17])
def test_scan_equals_ref_in_float64(f):
    assert_same_value_and_gradient(
        selective_scan, selective_scan_ref, scan_inputs(2, f, 3, 4), tol=1e-10
    )


def test_scan_equals_ref_in_float32_at_size():
    inputs = scan_inputs(3, 150, 32, 16, torch.float32)
    assert_same_value_and_gradient(selective_scan, selective_scan_ref, inputs, tol=1e-4)


def test_scan_gradcheck():
    assert torch.autograd.gradcheck(selective_scan, scan_inputs(1, 3, 2, 2))


@pytest.mark.parametrize("f, chunk", [(1, 4), (8, 4), (17, 5), (10, 50), (7, 1)])
def test_ssd_equals_ref_in_float64(f, chunk):
    assert_same_value_and_gradient(
        lambda *x: ssd_scan(*x, chunk=chunk), ssd_scan_ref, ssd_inputs(2, f, 2, 3, 4), tol=1e-10
    )


def test_ssd_equals_ref_in_float32_at_size():
    inputs = ssd_inputs(3, 150, 4, 8, 16, torch.float32)
    assert_same_value_and_gradient(ssd_scan, ssd_scan_ref, inputs, tol=1e-4)


def test_ssd_gradcheck():
    inputs = ssd_inputs(1, 5, 2, 1, 2)
    assert torch.autograd.gradcheck(lambda *x: ssd_scan(*x, chunk=2), inputs)


def test_ssd_survives_strong_decay():
    u, delta, A, B, C, D = ssd_inputs(1, 150, 2, 2, 3, torch.float32)
    y = ssd_scan(u, delta * 100, A * 10, B, C, D)  # exp(-1000) and its inverse never both appear
    y.sum().backward()
    assert y.isfinite().all() and u.grad.isfinite().all() and delta.grad.isfinite().all()


def test_segsum_is_the_sum_between():
    a = torch.randn(2, 6)
    out = segsum(a)
    for i in range(6):
        for j in range(6):
            want = a[:, j + 1 : i + 1].sum(-1) if j <= i else torch.full((2,), -torch.inf)
            torch.testing.assert_close(out[:, i, j], want)


@BLOCKS
def test_block_is_causal(make):
    x = torch.randn(2, 12, 16)
    changed = x.clone()
    changed[:, 7] += 1
    block = make(16)
    torch.testing.assert_close(block(changed)[:, :7], block(x)[:, :7])
    assert (block(changed)[:, 7:] - block(x)[:, 7:]).abs().amin(dim=(0, 2)).min() > 0


@BLOCKS
def test_block_remembers_beyond_its_filter(make):
    """The convolution sees 4 frames; what frame 0 does to frame 11 went through the state."""
    x = torch.randn(1, 12, 16, requires_grad=True)
    make(16)(x)[:, 11].sum().backward()
    assert x.grad[:, 0].abs().max() > 0


def test_block_equations_of_mamba():
    """The block against the equations of its docstring, step by step."""
    block = MambaBlock(16, d_state=3)
    x = torch.randn(2, 9, 16)
    u, z = block.in_proj(x).chunk(2, -1)
    padded = torch.cat([torch.zeros(2, 3, 32), u], dim=1)
    taps = block.conv.weight[:, 0]
    u = torch.stack([(padded[:, i : i + 4] * taps.T).sum(1) for i in range(9)], 1)
    u = torch.nn.functional.silu(u + block.conv.bias)
    dt, B, C = block.x_proj(u).split([1, 3, 3], -1)
    delta = torch.nn.functional.softplus(block.dt_proj(dt))
    y = selective_scan_ref(u, delta, -block.A_log.exp(), B, C, block.D_skip)
    expected = block.out_proj(y * torch.nn.functional.silu(z))
    torch.testing.assert_close(block(x), expected)


@BLOCKS
def test_block_starts_with_delta_in_range(make):
    block = make(64)
    bias = block.dt_bias if isinstance(block, SSDBlock) else block.dt_proj.bias
    delta = torch.nn.functional.softplus(bias)
    assert delta.min() > 0.99e-3 and delta.max() < 0.101


def test_frames_last_from_a_thousandth_to_a_tenth_log_uniformly():
    bias = torch.empty(4000)
    init_delta(bias)
    decades = torch.nn.functional.softplus(bias).log10()
    torch.testing.assert_close(
        decades.quantile(torch.tensor([0.0, 0.25, 0.5, 0.75, 1.0])),
        torch.tensor([-3.0, -2.5, -2.0, -1.5, -1.0]),
        atol=0.05,
        rtol=0,
    )


@BLOCKS
def test_scan_stays_in_float32_under_autocast(make):
    block, x = make(32), torch.randn(2, 60, 32)
    seen = []
    scan = block.scan
    block.scan = lambda *inputs: seen.append(scan(*inputs)) or seen[-1]
    with torch.autocast("cpu", torch.bfloat16):
        y = block(x)
    assert seen[0].dtype == torch.float32
    torch.testing.assert_close(y.float(), block(x), atol=0.05, rtol=0.05)


def test_mamba_has_the_papers_parameter_count():
    """1,694,720 for d_model 512 (arithmetic of Mamba section 3.4)."""
    block = MambaBlock(512)
    assert sum(p.numel() for p in block.parameters()) == 1_694_720


def test_wrong_options_are_named():
    with pytest.raises(ValueError, match="head_dim=24"):
        SSDBlock(16, head_dim=24)


@BLOCKS
def test_a_batch_may_be_empty_and_weights_may_be_double(make):
    block, x = make(16), torch.randn(2, 9, 16)
    assert block(x[:0]).shape == (0, 9, 16)
    exact = copy.deepcopy(block).double()(x.double())
    assert exact.dtype == torch.float64
    torch.testing.assert_close(exact.float(), block(x), atol=1e-5, rtol=1e-4)
