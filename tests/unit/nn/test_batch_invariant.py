"""Rows that do not depend on their neighbours."""

import pytest
import torch
from torch.nn.functional import linear, softplus

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.ssd import batch_invariant_softplus
from dancediff.nn.conditioning import BatchInvariantLinear
from tiny_lodge import tiny_lodge


@pytest.mark.parametrize("b", [1, 2, 3, 7, 15])
def test_a_row_is_the_same_in_every_batch(b):
    torch.manual_seed(0)
    layer, x = BatchInvariantLinear(128, 256), torch.randn(16, 128)
    with torch.no_grad():
        assert torch.equal(layer(x)[:b], layer(x[:b]))
        torch.testing.assert_close(layer(x), linear(x, layer.weight, layer.bias))


def test_it_learns_as_any_linear_layer():
    torch.manual_seed(0)
    layer, x = BatchInvariantLinear(8, 4), torch.randn(5, 8)
    layer(x).square().sum().backward()
    y = linear(x, layer.weight, layer.bias)
    torch.testing.assert_close(layer.weight.grad, 2 * y.mT.detach() @ x)


@pytest.mark.parametrize("f", [1, 7, 150])
def test_softplus_is_the_same_in_every_batch(f):
    """PyTorch's own is not, where a batch ends within its stride."""
    x = 4 * torch.randn(12, f, 4, generator=torch.Generator().manual_seed(0)).requires_grad_()
    whole = batch_invariant_softplus(x)
    for b in range(1, 12):
        assert torch.equal(batch_invariant_softplus(x[:b]), whole[:b]), b
    torch.testing.assert_close(whole, softplus(x))
    ours, theirs = (torch.autograd.grad(y.square().sum(), x)[0] for y in (whole, softplus(x)))
    torch.testing.assert_close(ours, theirs)


def test_a_segment_is_guessed_the_same_in_every_batch():
    """Of layers that see all frames, too: the whole local network, to the last bit."""
    torch.manual_seed(0)
    sizes = {"d_model": 64, "num_heads": 4, "num_layers": 2, "ff_dim": 512}
    model = tiny_lodge(second=sizes, frames=256).local_stage
    x, M = torch.randn(16, 256, 139), torch.randn(16, 256, 35)
    style, t = torch.randn(16, 64), torch.full((16,), 500)

    def guess(b):
        with torch.no_grad():
            return model(
                x[:b],
                t[:b],
                Conditions(M[:b], style=style[:b], music_mask=torch.ones(b, dtype=torch.bool)),
            )[1]

    whole = guess(16)
    for b in (1, 2, 7):
        assert torch.equal(guess(b), whole[:b]), b
