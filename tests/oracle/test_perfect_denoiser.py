"""A network that always knows the answer must get it back from every sampler."""

import math

import pytest
import torch

from dancediff.diffusion.ddim import ddim_step
from dancediff.diffusion.pinning import MODES, Pinning
from dancediff.diffusion.samplers import SamplerOptions, sample
from dancediff.diffusion.schedule import cosine_abar, q_sample

ABAR = cosine_abar()
X_0 = torch.rand(2, 3, 10, 4, generator=torch.Generator().manual_seed(0)) * 2 - 1


def perfect(x_t, t):
    return X_0


@pytest.mark.parametrize("eta", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("steps", [1, 2, 7, 50, 1000])
def test_ddim_recovers_x_0(steps, eta):
    x = sample(perfect, X_0.shape, SamplerOptions(ABAR, "ddim", steps, eta=eta))
    assert torch.equal(x, X_0)


def test_ddpm_recovers_x_0():
    assert torch.equal(sample(perfect, X_0.shape, SamplerOptions(ABAR, "ddpm", 50, eta=1.0)), X_0)


@pytest.mark.parametrize("mode", MODES)
def test_pinned_sampling_recovers_x_0(mode):
    pin = Pinning(X_0[:, :, :5], ABAR, mode=mode)
    x = sample(perfect, X_0.shape, SamplerOptions(ABAR, "ddim", 8, eta=1.0), pin=pin)
    assert torch.equal(x, X_0)


@pytest.mark.parametrize(("t", "t_next"), [(999, 979), (500, 100), (19, 0)])
def test_without_eta_a_step_lands_on_q(t, t_next):
    eps = torch.randn(X_0.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    x_0 = X_0.double()
    x_t = q_sample(x_0, t, ABAR, eps)
    landed = ddim_step(x_t, x_0, t, t_next, ABAR, eta=0.0)
    torch.testing.assert_close(landed, q_sample(x_0, t_next, ABAR, eps), atol=1e-9, rtol=1e-9)


@pytest.mark.parametrize("sampler", ["ddim", "ddpm"])
def test_gaussian_data_come_out_with_their_mean_and_spread(sampler):
    # For x_0 ~ N(m, s^2) the perfect guess is known, and the samples must follow that law.
    m, s = 0.2, 0.15

    def posterior_mean(x_t, t):
        a = float(ABAR[t])
        gain = math.sqrt(a) * s**2 / (a * s**2 + 1 - a)
        return m + gain * (x_t - math.sqrt(a) * m)

    options, g = SamplerOptions(ABAR, sampler, 200, eta=1.0), torch.Generator().manual_seed(2)
    x = sample(posterior_mean, (1, 1, 100, 60), options, generator=g)
    assert float(x.mean()) == pytest.approx(m, abs=0.01)
    assert float(x.std()) == pytest.approx(s, rel=0.06)
