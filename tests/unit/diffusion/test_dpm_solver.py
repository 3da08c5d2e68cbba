"""DPM-Solver++: its times, its step, and how well it solves the flow."""

import math
from itertools import pairwise

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

from dancediff.diffusion.dpm_solver import dpm_step, half_logsnr, logsnr_times
from dancediff.diffusion.samplers import SamplerOptions, sample
from dancediff.diffusion.schedule import cosine_abar

ABAR = cosine_abar(1000)
SHAPE = (1, 2, 6, 4)


def gen(seed=0):
    return torch.Generator().manual_seed(seed)


def test_dpm_step_by_hand():
    abar = torch.tensor([0.9, 0.64, 0.25], dtype=torch.float64)
    x_t, x0, last = (torch.full((1, 1, 1, 1), v, dtype=torch.float64) for v in (2.0, 0.4, 0.1))
    level = [0.5 * math.log(a / (1 - a)) for a in (0.9, 0.64, 0.25)]
    h, h_last = level[0] - level[1], level[1] - level[2]
    D = (1 + h / (2 * h_last)) * 0.4 - h / (2 * h_last) * 0.1
    flow = math.sqrt(0.1 / 0.36) * 2.0 + math.sqrt(0.9) * (1 - math.exp(-h)) * D
    out = dpm_step(x_t, x0, 1, 0, abar, before=(last, 2), eta=0.0)
    assert out.item() == pytest.approx(flow)
    z = torch.randn(1, 1, 1, 1, generator=gen(3)).item()
    noisy = math.sqrt(0.1 / 0.36) * math.exp(-h) * 2.0
    noisy += math.sqrt(0.9) * (1 - math.exp(-2 * h)) * D
    noisy += math.sqrt(0.1) * math.sqrt(1 - math.exp(-2 * h)) * z
    out = dpm_step(x_t, x0, 1, 0, abar, before=(last, 2), eta=1.0, generator=gen(3))
    assert out.item() == pytest.approx(noisy, abs=1e-6)


@pytest.mark.parametrize("steps", [2, 6, 15, 20, 50])
def test_dpm_times_are_even_in_the_signal_to_noise_ratio(steps):
    times = logsnr_times(steps, ABAR)
    assert times[0] == 992 and times[-2:] == [0, -1] and all(a > b for a, b in pairwise(times))
    assert steps - 1 <= len(times) - 1 <= steps
    levels = np.array([half_logsnr(ABAR, t) for t in times[:-1]])
    even = np.linspace(levels[0], levels[-1], steps)
    if steps <= 20:  # the last steps lie a fifth apart, and t is a whole number
        assert np.abs(levels - even).max() < 0.2


@pytest.mark.parametrize("steps", [4, 8, 12])
def test_the_last_guess_may_be_taken_where_noise_is_left(steps):
    times = logsnr_times(steps, ABAR, sigma_min=0.16)
    assert times[0] == 992 and times[-1] == -1 and len(times) == steps + 1
    last = float(ABAR[times[-2]])
    assert math.sqrt((1 - last) / last) == pytest.approx(0.16, abs=0.002)
    levels = np.array([half_logsnr(ABAR, t) for t in times[:-1]])
    assert np.abs(np.diff(levels, 2)).max() < 0.1, "evenly spaced"
    asked = []
    options = SamplerOptions(ABAR, "dpm", steps, eta=0.0, sigma_min=0.16)
    sample(lambda x, t: (asked.append(t), x / 2)[1], SHAPE, options, generator=gen())
    assert asked == times[:-1]


def two_poses(x, a):
    """The exact guess where a dance is one of two poses, +1 or -1, each with a spread of 0.2."""
    s2 = a * 0.04 + 1 - a
    odds = np.tanh(np.sqrt(a) * x / s2)
    return odds + np.sqrt(a) * 0.04 / s2 * (x - np.sqrt(a) * odds)


def test_dpm_solves_the_flow_and_twice_the_steps_are_four_times_as_close():
    """Against an integrator of general use: with y = x / sigma, dy / d lambda = e^lambda x0_hat."""
    start, end, x_T = -3.0, 3.0, 0.7

    def flow(level, y):
        a = 1 / (1 + np.exp(-2 * level))
        return np.exp(level) * two_poses(np.sqrt(1 - a) * y, a)

    first, final = (1 / np.sqrt(1 + np.exp(2 * v)) for v in (start, end))
    exact = solve_ivp(flow, (start, end), [x_T / first], rtol=1e-10, atol=1e-10).y[0, -1] * final
    errors = {}
    for steps in (10, 20, 40, 80):
        levels = torch.linspace(end, start, steps + 1, dtype=torch.float64)
        abar = torch.sigmoid(2 * levels)
        x, before = torch.tensor([[[[x_T]]]], dtype=torch.float64), None
        for t in range(steps, 0, -1):
            x0_hat = torch.as_tensor(two_poses(x.numpy(), abar[t].item()))
            x = dpm_step(x, x0_hat, t, t - 1, abar, before=before, eta=0.0)
            before = (x0_hat, t)
        errors[steps] = abs(x.item() - exact)
    assert errors[20] < 0.01
    assert errors[20] / errors[40] > 3 and errors[40] / errors[80] > 3


def spread_after(spread, **kind):
    """How large motion of a size comes out, where every guess is exact, as a share of its size."""
    x_0 = spread * torch.randn(20_000, 1, 1, 1, generator=gen(1))

    def exact(x_t, t):
        a = float(ABAR[t])
        return math.sqrt(a) * spread**2 / (a * spread**2 + 1 - a) * x_t

    x = sample(
        exact,
        x_0.shape,
        SamplerOptions(ABAR, clamp=None, **kind),
        generator=gen(0),
    )
    return (x.std() / spread).item()


@pytest.mark.parametrize("eta", [0.0, 1.0])
def test_dpm_keeps_formations_and_jumps_at_their_size(eta):
    """DDIM shrinks both ends with as many steps, for it takes each guess as final."""
    sizes = (7.2, 1.0, 0.3, 0.05)  # of the slowest and of ever faster parts of a dance
    for size in sizes:
        assert spread_after(size, sampler="dpm", steps=20, eta=eta) == pytest.approx(1, abs=0.06)
    shrunk = [spread_after(size, sampler="ddim", steps=20, eta=eta) for size in sizes]
    assert shrunk[0] < 0.85 and shrunk[-1] < 0.5


def test_dpm_asks_no_more_often_than_it_has_steps():
    asked = []

    def count(x_t, t):
        asked.append(t)
        return x_t

    sample(count, SHAPE, SamplerOptions(ABAR, "dpm", 12, eta=1.0), generator=gen())
    assert asked == logsnr_times(12, ABAR)[:-1] and len(asked) == 12
