import math
from itertools import pairwise

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

from dancediff.diffusion.samplers import (
    SamplerOptions,
    ddim_step,
    ddim_times,
    ddpm_step,
    dpm_step,
    half_logsnr,
    logsnr_times,
    sample,
    sampling_times,
)
from dancediff.diffusion.schedule import cosine_abar, gaussian, q_sample

ABAR = cosine_abar(1000)
SHAPE = (1, 2, 6, 4)


def gen(seed=0):
    return torch.Generator().manual_seed(seed)


def shrink(x_t, t):
    """A denoiser that is wrong, and wrong differently at every step."""
    return x_t * 0.5 + 0.1 * math.sin(t)


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


KINDS = ["ddim", "ddpm", "dpm"]


@pytest.mark.parametrize("kind", KINDS)
def test_seed_fixes_the_bits(kind):
    runs = [
        sample(shrink, SHAPE, SamplerOptions(ABAR, kind, 9, eta=1.0), generator=gen(s))
        for s in (4, 4, 5)
    ]
    assert torch.equal(runs[0], runs[1])
    assert not torch.allclose(runs[0], runs[2], atol=1e-3)


def test_without_eta_only_the_start_is_random():
    used, fresh = gen(), gen()
    x_T = torch.randn(SHAPE, generator=fresh)
    a = sample(shrink, SHAPE, SamplerOptions(ABAR, "ddim", 9, eta=0.0), generator=used)
    b = sample(shrink, SHAPE, SamplerOptions(ABAR, "ddim", 9, eta=0.0), x_T=x_T)
    assert torch.equal(a, b)
    assert torch.equal(used.get_state(), fresh.get_state())


def test_last_step_draws_no_noise():
    seen = []
    x = sample(
        shrink,
        SHAPE,
        SamplerOptions(ABAR, "ddim", 5, eta=1.0),
        generator=gen(),
        callback=lambda i, total, x0_hat: seen.append((i, total, x0_hat)),
    )
    assert [s[:2] for s in seen] == [(i, 5) for i in range(5)]
    assert torch.equal(x, seen[-1][2])


def test_guesses_are_cut():
    far = lambda x_t, t: torch.full_like(x_t, 7.0)  # noqa: E731
    assert sample(far, SHAPE, SamplerOptions(ABAR, "ddim", 3, eta=1.0)).unique().tolist() == [1.0]
    assert sample(
        far, SHAPE, SamplerOptions(ABAR, "ddim", 3, eta=1.0, clamp=None)
    ).unique().tolist() == [7.0]
    halved = sample(
        far, SHAPE, SamplerOptions(ABAR, "ddim", 3, eta=1.0, clamp=lambda x0_hat: x0_hat / 2)
    )
    assert halved.unique().tolist() == [3.5]


def test_dtype_is_kept():
    x_T = gaussian(SHAPE, generator=gen(), dtype=torch.float64)
    x = sample(shrink, SHAPE, SamplerOptions(ABAR, "ddim", 3, eta=1.0), generator=gen(), x_T=x_T)
    assert x.dtype == torch.float64 and not x.requires_grad


def test_sample_errors():
    for options, match in [
        (("euler", 5, 1.0), "sampler='euler'"),
        (("ddim", 0, 1.0), "steps=0"),
        (("ddim", 5, 2.0), "eta=2.0"),
    ]:
        with pytest.raises(ValueError, match=match):
            sample(shrink, SHAPE, SamplerOptions(ABAR, *options))
    with pytest.raises(ValueError, match="x_T"):
        x_T = torch.zeros(1, 2, 3, 4)
        sample(shrink, SHAPE, SamplerOptions(ABAR, "ddim", 5, 1.0), x_T=x_T)


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
    sample(lambda x, t: (asked.append(t), shrink(x, t))[1], SHAPE, options, generator=gen())
    assert asked == times[:-1]


def test_unknown_samplers_and_steps_are_named():
    with pytest.raises(ValueError, match=r"sigma_min=1.5 must lie in 0 \.\.\. 1"):
        logsnr_times(5, ABAR, sigma_min=1.5)
    with pytest.raises(ValueError, match="sampler='euler' is not one of 'dpm', 'ddim', 'ddpm'"):
        sampling_times("euler", 5)
    with pytest.raises(ValueError, match="steps=0 "):
        logsnr_times(0, ABAR)


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


class Higher:
    """A hook that leaves the range of the guesses."""

    def apply(self, x0_hat, abar):
        return x0_hat + 5


@pytest.mark.parametrize("how", ["dpm", "ddim", "ddpm"])
def test_hooks_have_the_last_word_about_a_guess(how):
    """What they change is not cut again."""
    options = SamplerOptions(cosine_abar(40), how, 3, eta=0.0, clamp=1.0)
    x = sample(lambda x_t, t: torch.full_like(x_t, 9.0), SHAPE, options, hooks=[Higher()])
    assert torch.equal(x, torch.full(SHAPE, 6.0))


def test_the_first_input_is_pinned_as_are_all_others():
    class Zeros:
        def start(self, x_T):
            return 0 * x_T

        def __call__(self, x_next, t_next):
            return 0 * x_next

    seen = []
    denoise = lambda x_t, t: seen.append(x_t) or x_t + 1  # noqa: E731
    sample(denoise, SHAPE, SamplerOptions(ABAR, "ddim", 3, eta=0.0), pin=Zeros())
    assert len(seen) == 3 and not any(x.any() for x in seen)
