"""DDPM: its step."""

import math

import pytest
import torch

from dancediff.diffusion.ddim import ddim_step
from dancediff.diffusion.ddpm import ddpm_step
from dancediff.diffusion.schedule import cosine_abar

ABAR = cosine_abar(1000)
SHAPE = (1, 2, 6, 4)


def gen(seed=0):
    return torch.Generator().manual_seed(seed)


def test_ddpm_step_by_hand():
    # abar = 0.64 then 0.25, so alpha = 0.390625 and beta = 0.609375
    abar = torch.tensor([0.64, 0.25], dtype=torch.float64)
    x_t, x0 = torch.full((1, 1, 1, 2), 2.0), torch.full((1, 1, 1, 2), 0.4)
    mean = 0.8 * 0.609375 / 0.75 * 0.4 + math.sqrt(0.390625) * 0.36 / 0.75 * 2.0
    z = torch.randn((1, 1, 1, 2), generator=gen(5))
    expected = mean + math.sqrt(0.36 / 0.75 * 0.609375) * z
    torch.testing.assert_close(ddpm_step(x_t, x0, 1, abar, generator=gen(5)), expected)


@pytest.mark.parametrize("t", [1, 99, 500, 998, 999])
def test_ddpm_is_ddim_with_eta_one_and_unit_steps(t):
    x_t, x0 = torch.randn(2, *SHAPE, dtype=torch.float64, generator=gen()).unbind(0)
    a = ddpm_step(x_t, x0, t, ABAR, generator=gen(1))
    b = ddim_step(x_t, x0, t, t - 1, ABAR, eta=1.0, generator=gen(1))
    torch.testing.assert_close(a, b, atol=1e-9, rtol=1e-9)
