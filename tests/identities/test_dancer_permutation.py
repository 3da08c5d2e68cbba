"""Acceptance check 6: what makes the network know left from right, and what does not."""

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig


def outputs(order, *without, extensions=()):
    """The network's answer to a group, and to the same group in another order, put back."""
    torch.manual_seed(0)
    sizes = {"d_model": 16, "num_heads": 2, "num_layers": 2, "ff_dim": 32, "fusion_hidden": 48}
    model = build(TCDiffPP, TCDiffPPConfig(**sizes, without=without), extensions).eval()
    n = len(order)
    x_t, M, t = torch.randn(2, n, 12, 151), torch.randn(2, 12, 35), torch.tensor([20, 700])
    S = torch.arange(n).expand(2, n)
    with torch.no_grad():
        return model(x_t, t, Conditions(M, S))[1][:, order], model(
            x_t[:, order], t, Conditions(M, S)
        )[1]


ORDERS = [[1, 0], [2, 0, 1], [4, 2, 0, 1, 3]]
GROUP = ("dancer_positioning", "fusion_projection")


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("more", [(), ("ssm",)])
@pytest.mark.parametrize("extensions", [(), ("ssd", "preconditioning")])
def test_without_dpe_and_fp_dancers_are_interchangeable(order, more, extensions):
    permuted_after, permuted_before = outputs(order, *GROUP, *more, extensions=extensions)
    torch.testing.assert_close(permuted_before, permuted_after, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("missing", GROUP)
def test_dpe_or_fp_tell_left_from_right(order, missing):
    permuted_after, permuted_before = outputs(order, missing)
    assert (permuted_before - permuted_after).abs().max() > 1e-2
