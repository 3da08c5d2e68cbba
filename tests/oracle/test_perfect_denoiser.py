"""A network that always knows the answer must get it back from every sampler."""

import math

import pytest
import torch

from dancediff.diffusion.ddim import ddim_step
from dancediff.diffusion.pinning import MODES, Pinning
from dancediff.diffusion.samplers import SamplerOptions, sample, sampling_times
from dancediff.diffusion.schedule import cosine_abar, q_sample

ABAR = cosine_abar()
X_0 = torch.rand(2, 3, 10, 4, generator=torch.Generator().manual_seed(0)) * 2 - 1


def perfect(x_t, t):
    return X_0


@pytest.mark.parametrize("sampler", ["ddim", "dpm"])
@pytest.mark.parametrize("steps", [1, 2, 7, 50, 1000])
def test_who_knows_the_noise_alone_gets_x_0_back(steps, sampler):
    """The guess is right only while x_t lies where that noise puts it: so at every step."""
    first = sampling_times(sampler, steps, ABAR)[0]
    eps = torch.randn(X_0.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    x_T = q_sample(X_0.double(), first, ABAR, eps)

    def knows(x_t, t):
        a = float(ABAR[t])
        return (x_t - math.sqrt(1 - a) * eps) / math.sqrt(a)

    options = SamplerOptions(ABAR, sampler, steps, eta=0.0, clamp=None)
    x = sample(knows, X_0.shape, options, x_T=x_T)
    torch.testing.assert_close(x, X_0.double(), atol=1e-6, rtol=0)


@pytest.mark.parametrize("eta", [0.3, 1.0])
@pytest.mark.parametrize("sampler", ["ddim", "ddpm", "dpm"])
def test_the_last_guess_is_the_dance(sampler, eta):
    x = sample(perfect, X_0.shape, SamplerOptions(ABAR, sampler, 7, eta=eta))
    assert torch.equal(x, X_0)


X_T = torch.randn(X_0.shape, generator=torch.Generator().manual_seed(3))


def inputs_of_the_network(x_T, pin=None):
    """{t: x_t} of all calls, by DDIM under noise of one seed; X_0 must come out."""
    seen = {}

    def watched(x_t, t):
        seen[t] = x_t
        return X_0

    options, g = SamplerOptions(ABAR, "ddim", 8, eta=1.0), torch.Generator().manual_seed(4)
    assert torch.equal(sample(watched, X_0.shape, options, x_T=x_T, pin=pin, generator=g), X_0)
    return seen


@pytest.mark.parametrize("mode", MODES)
def test_pinned_frames_are_where_their_mode_puts_them_and_free_frames_stay(mode):
    known, noise = X_0[:, :, :5], X_T[:, :, :5]
    pin = Pinning(known, ABAR, mode=mode, generator=torch.Generator().manual_seed(5))
    seen, free = inputs_of_the_network(X_T, pin), inputs_of_the_network(pin.start(X_T))
    assert len(seen) == 8 and all(torch.equal(seen[t][:, :, 5:], free[t][:, :, 5:]) for t in seen)
    drawn = []
    for t in list(seen)[1:]:
        x_t, a = seen[t][:, :, :5], float(ABAR[t])
        if mode == "clean":
            assert torch.equal(x_t, known)
        elif mode == "same_noise":
            torch.testing.assert_close(x_t, q_sample(known, t, ABAR, noise))
        elif mode == "init":
            assert torch.equal(x_t, free[t][:, :, :5])
        else:
            drawn.append((x_t - math.sqrt(a) * known) / math.sqrt(1 - a))
            assert float(drawn[-1].std()) == pytest.approx(1, abs=0.3)
    if mode == "renoise":  # fresh in every step
        alike = torch.corrcoef(torch.stack([noise, *drawn]).flatten(1))
        assert (alike - torch.eye(8)).abs().max() < 0.4


@pytest.mark.parametrize(("t", "t_next"), [(999, 979), (500, 100), (19, 0)])
def test_without_eta_a_step_lands_on_q(t, t_next):
    eps = torch.randn(X_0.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    x_0 = X_0.double()
    x_t = q_sample(x_0, t, ABAR, eps)
    landed = ddim_step(x_t, x_0, t, t_next, ABAR, eta=0.0)
    torch.testing.assert_close(landed, q_sample(x_0, t_next, ABAR, eps), atol=1e-9, rtol=1e-9)


@pytest.mark.parametrize("sampler", ["ddim", "ddpm", "dpm"])
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
