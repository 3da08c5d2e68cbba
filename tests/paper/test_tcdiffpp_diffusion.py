"""Numbered equations of TCDiff++ that concern the diffusion itself."""

import math

import torch

from dancediff.diffusion.ddpm import ddpm_step
from dancediff.diffusion.pinning import Pinning
from dancediff.diffusion.schedule import cosine_abar, q_sample

ABAR = cosine_abar(20)


def test_tcdiffpp_eq01_forward_steps_compose_to_q_sample():
    # x_t = sqrt(alpha_t) x_{t-1} + sqrt(1 - alpha_t) z, by mean and variance, step after step
    mean, variance = 1.0, 0.0
    for t in range(20):
        alpha = float(ABAR[t] / ABAR[t - 1]) if t else float(ABAR[0])
        mean, variance = math.sqrt(alpha) * mean, alpha * variance + 1 - alpha
        one, zero = torch.ones(1, 1, 1, 1), torch.zeros(1, 1, 1, 1)
        torch.testing.assert_close(q_sample(one, t, ABAR, zero).item(), mean, atol=1e-6, rtol=0)
        noise = q_sample(zero, t, ABAR, one).item()
        torch.testing.assert_close(noise**2, variance, atol=1e-6, rtol=0)


def test_tcdiffpp_eq02_reverse_step_is_bayes_rule():
    # q(x_{t-1} | x_t, x_0) is the product of two Gaussians in x_{t-1}: precisions add up.
    t, x_0, x_t = 7, 0.4, 1.3
    alpha, a_prev = float(ABAR[t] / ABAR[t - 1]), float(ABAR[t - 1])
    prior = 1 / (1 - a_prev), math.sqrt(a_prev) * x_0
    evidence = alpha / (1 - alpha), x_t / math.sqrt(alpha)
    precision = prior[0] + evidence[0]
    mean = (prior[0] * prior[1] + evidence[0] * evidence[1]) / precision
    x = ddpm_step(
        torch.full((1, 1, 500, 200), x_t),
        torch.full((1, 1, 500, 200), x_0),
        t,
        ABAR,
        generator=torch.Generator().manual_seed(0),
    )
    assert abs(float(x.mean()) - mean) < 5 * precision**-0.5 / math.sqrt(1e5)
    assert abs(float(x.std()) * precision**0.5 - 1) < 0.01


def test_tcdiffpp_eq19_input_is_noised_past_then_fresh_noise():
    past = torch.rand(1, 2, 75, 3)
    z = torch.randn(1, 2, 150, 3)
    z_hat = Pinning(past, ABAR, mode="init").start(z)
    assert torch.equal(z_hat[:, :, :75], q_sample(past, len(ABAR) - 1, ABAR, z[:, :, :75]))
    assert torch.equal(z_hat[:, :, 75:], z[:, :, 75:])


def test_tcdiffpp_eq19_taken_literally_hands_over_nothing():
    # "add noise to obtain x_T": at the last step two different pasts give the same input.
    abar, z = cosine_abar(1000), torch.randn(1, 2, 150, 3)
    a, b = (Pinning(torch.full((1, 2, 75, 3), v), abar, mode="init").start(z) for v in (-1.0, 1.0))
    assert float((a - b).abs().max()) < 1e-4
