"""DDIM: its times and its step."""

import math
from itertools import pairwise

import pytest
import torch

from dancediff.diffusion.ddim import ddim_step, ddim_times
from dancediff.diffusion.schedule import cosine_abar, q_sample

ABAR = cosine_abar(1000)
SHAPE = (1, 2, 6, 4)


def gen(seed=0):
    return torch.Generator().manual_seed(seed)


def test_fifty_times_are_those_of_the_papers():
    times = ddim_times(50)
    assert times == [*range(999, 18, -20), -1]
    assert len(times) == 51


@pytest.mark.parametrize("steps", [1, 2, 7, 30, 50, 333, 999, 1000])
def test_times_are_the_truncated_linspace(steps):
    times = ddim_times(steps)
    exact = torch.linspace(-1, 999, steps + 1, dtype=torch.float64).flip(0)
    assert times == [*(exact[:-1] + 1e-9).trunc().int().tolist(), -1]
    assert times[0] == 999 and all(a > b for a, b in pairwise(times))


@pytest.mark.parametrize("steps", [0, -3, 1001])
def test_times_out_of_range(steps):
    with pytest.raises(ValueError, match=f"steps={steps} "):
        ddim_times(steps)


def test_ddim_step_by_hand():
    # a = 0.25, a' = 0.64, eta = 1: sigma^2 = (1 - 0.64) / (1 - 0.25) * (1 - 0.25 / 0.64)
    abar = torch.tensor([0.64, 0.25], dtype=torch.float64)
    x_t, x0 = torch.full((2, 1, 1, 1, 1), 2.0), torch.full((2, 1, 1, 1, 1), 0.4)
    eps = (2.0 - 0.5 * 0.4) / math.sqrt(0.75)
    out = ddim_step(x_t, x0, 1, 0, abar, eta=0.0)
    assert out.unique().item() == pytest.approx(0.8 * 0.4 + 0.6 * eps, abs=1e-6)
    sigma2 = 0.36 / 0.75 * (1 - 0.25 / 0.64)
    z = torch.randn((2, 1, 1, 1, 1), generator=gen(3))
    expected = 0.8 * 0.4 + math.sqrt(0.36 - sigma2) * eps + math.sqrt(sigma2) * z
    torch.testing.assert_close(ddim_step(x_t, x0, 1, 0, abar, eta=1.0, generator=gen(3)), expected)


def test_ddim_keeps_the_marginal_for_every_eta():
    # If x_t ~ q(x_t | x_0) and the guess is right, x_t' ~ q(x_t' | x_0), whatever eta.
    x0 = torch.full((1, 1, 300, 200), 0.3)
    x_t = q_sample(x0, 600, ABAR, torch.randn(x0.shape, generator=gen()))
    a = float(ABAR[300])
    for eta in (0.0, 0.4, 1.0):
        x = ddim_step(x_t, x0, 600, 300, ABAR, eta=eta, generator=gen(1))
        assert float(x.mean()) == pytest.approx(0.3 * math.sqrt(a), abs=0.01)
        assert float(x.var()) == pytest.approx(1 - a, rel=0.02)


def test_step_errors():
    x = torch.zeros(SHAPE)
    with pytest.raises(ValueError, match="t_next=5 must be below t=5"):
        ddim_step(x, x, 5, 5, ABAR, eta=0.0)
    for eta in (-0.1, 1.5):
        with pytest.raises(ValueError, match=f"eta={eta} "):
            ddim_step(x, x, 5, 4, ABAR, eta=eta)
