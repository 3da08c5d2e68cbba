import math
from itertools import pairwise

import pytest
import torch

from dancediff.diffusion.pinning import Pinning
from dancediff.diffusion.samplers import ddim_step, ddim_times, ddpm_step, sample
from dancediff.diffusion.schedule import cosine_abar, q_sample

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
        ddim_step(x, x, 5, 5, ABAR)
    for eta in (-0.1, 1.5):
        with pytest.raises(ValueError, match=f"eta={eta} "):
            ddim_step(x, x, 5, 4, ABAR, eta=eta)


@pytest.mark.parametrize("kind", [{"sampler": "ddim", "steps": 9}, {"sampler": "ddpm"}])
def test_seed_fixes_the_bits(kind):
    runs = [sample(shrink, SHAPE, abar=ABAR, generator=gen(s), **kind) for s in (4, 4, 5)]
    assert torch.equal(runs[0], runs[1])
    assert not torch.allclose(runs[0], runs[2], atol=1e-3)


def test_without_eta_only_the_start_is_random():
    used, fresh = gen(), gen()
    x_T = torch.randn(SHAPE, generator=fresh)
    a = sample(shrink, SHAPE, abar=ABAR, steps=9, eta=0.0, generator=used)
    b = sample(shrink, SHAPE, abar=ABAR, steps=9, eta=0.0, x_T=x_T)
    assert torch.equal(a, b)
    assert torch.equal(used.get_state(), fresh.get_state())


def test_last_step_draws_no_noise():
    seen = []
    x = sample(
        shrink,
        SHAPE,
        abar=ABAR,
        steps=5,
        generator=gen(),
        callback=lambda i, total, x0_hat: seen.append((i, total, x0_hat)),
    )
    assert [s[:2] for s in seen] == [(i, 5) for i in range(5)]
    assert torch.equal(x, seen[-1][2])


def test_guesses_are_cut():
    far = lambda x_t, t: torch.full_like(x_t, 7.0)  # noqa: E731
    assert sample(far, SHAPE, abar=ABAR, steps=3).unique().tolist() == [1.0]
    assert sample(far, SHAPE, abar=ABAR, steps=3, clamp=None).unique().tolist() == [7.0]


def test_resample_repeats_every_step_but_the_last():
    calls = []
    denoise = lambda x_t, t: calls.append(t) or shrink(x_t, t)  # noqa: E731
    sample(denoise, SHAPE, abar=ABAR, steps=4, resample=3)
    assert calls == [999] * 3 + [749] * 3 + [499] * 3 + [249]


def test_resample_returns_to_the_noise_level_it_left():
    stds = []
    x0 = torch.full((1, 1, 200, 100), 0.5)

    def denoise(x_t, t):
        stds.append((t, float(x_t.std())))
        return x0

    sample(denoise, x0.shape, abar=ABAR, steps=4, resample=2, generator=gen())
    for t, std in stds:
        assert std == pytest.approx(math.sqrt(1 - float(ABAR[t])), rel=0.03)


def test_resample_lets_the_free_frames_follow_the_pinned_ones():
    # Data: one random number, the same in all frames. The exact denoiser averages the evidence.
    def denoise(x_t, t):
        snr = float(ABAR[t] / (1 - ABAR[t]))
        mean = x_t.mean(dim=2, keepdim=True) / math.sqrt(float(ABAR[t]))
        return (mean * snr * 8 / (snr * 8 + 1)).expand_as(x_t)

    def gap(resample):
        known = torch.full((400, 1, 4, 1), 0.8)
        x = sample(
            denoise,
            (400, 1, 8, 1),
            abar=ABAR,
            steps=20,
            generator=gen(),
            pin=Pinning(known, ABAR, generator=gen(1)),
            resample=resample,
            clamp=None,
        )
        return float((x[:, :, 4:] - 0.8).abs().mean())

    assert gap(8) < 0.8 * gap(1)


def test_dtype_is_kept():
    x = sample(shrink, SHAPE, abar=ABAR, steps=3, generator=gen(), dtype=torch.float64)
    assert x.dtype == torch.float64 and not x.requires_grad


def test_sample_errors():
    for options, match in [
        ({"sampler": "euler"}, "sampler='euler'"),
        ({"resample": 0}, "resample=0"),
        ({"steps": 0}, "steps=0"),
        ({"eta": 2.0}, "eta=2.0"),
        ({"x_T": torch.zeros(1, 2, 3, 4)}, "x_T"),
    ]:
        with pytest.raises(ValueError, match=match):
            sample(shrink, SHAPE, abar=ABAR, **options)
