"""The loop that takes the steps of a sampler."""

import math

import pytest
import torch

from dancediff.diffusion.dpm_solver import logsnr_times
from dancediff.diffusion.samplers import SamplerOptions, sample, sampling_times
from dancediff.diffusion.schedule import cosine_abar, gaussian

ABAR = cosine_abar(1000)
SHAPE = (1, 2, 6, 4)


def gen(seed=0):
    return torch.Generator().manual_seed(seed)


def shrink(x_t, t):
    """A denoiser that is wrong, and wrong differently at every step."""
    return x_t * 0.5 + 0.1 * math.sin(t)


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


@pytest.mark.parametrize("wrong", [lambda x: x[:, :1], lambda x: (x, x), lambda x: x[0]])
def test_a_guess_that_is_not_like_its_input_is_named_and_not_spread(wrong):
    with pytest.raises(ValueError, match=r"denoise returned .*; it must be like x_t"):
        sample(lambda x_t, t: wrong(x_t), SHAPE, SamplerOptions(ABAR, "ddim", 5, 1.0))


def test_unknown_samplers_and_steps_are_named():
    with pytest.raises(ValueError, match=r"sigma_min=1.5 must lie in 0 \.\.\. 1"):
        logsnr_times(5, ABAR, sigma_min=1.5)
    with pytest.raises(ValueError, match="sampler='euler' is not one of 'dpm', 'ddim', 'ddpm'"):
        sampling_times("euler", 5)
    with pytest.raises(ValueError, match="steps=0 "):
        logsnr_times(0, ABAR)


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
