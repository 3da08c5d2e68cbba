"""Every sampler, schedule and shape: what a network that knows the answer gets, and which bits."""

from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dancediff.diffusion.pinning import MODES, Pinning
from dancediff.diffusion.samplers import SAMPLERS, SamplerOptions, sample, sampling_times
from dancediff.diffusion.schedule import abar_at, cosine_abar, gaussian, q_sample
from dancediff.extensions.constraint import Constraint

often = settings(deadline=None, derandomize=True, max_examples=60)
seeds = st.integers(0, 2**32 - 1)
shapes = st.tuples(st.integers(1, 3), st.integers(1, 5), st.integers(1, 12), st.integers(1, 5))
etas = st.floats(0, 1)


@st.composite
def settings_of_a_sampler(draw):
    """A sampler with a schedule of any length and any number of steps that it allows."""
    sampler = draw(st.sampled_from(SAMPLERS))
    num_steps = draw(st.integers(1, 40) if sampler == "ddpm" else st.integers(1, 1000))
    steps = draw(st.integers(1, min(num_steps, 60)))
    return {"sampler": sampler, "abar": cosine_abar(num_steps), "steps": steps}


def options(how, eta):
    return SamplerOptions(**how, eta=eta)


def generator(seed):
    return torch.Generator().manual_seed(seed)


def clean(shape, seed):
    return torch.rand(shape, generator=generator(seed)) * 2 - 1


@often
@given(settings_of_a_sampler(), shapes, seeds)
def test_who_knows_the_noise_gets_the_answer(how, shape, seed):
    """A guess from x_t and the noise is right at the end only if every x_t before was."""
    if how["sampler"] == "ddpm":
        how["sampler"] = "ddim"
    x_0, eps = clean(shape, seed).double(), gaussian(shape, generator=generator(seed)).double()

    def knows(x_t, t):
        a = abar_at(how["abar"], t)
        return (x_t - (1 - a) ** 0.5 * eps) / a**0.5

    first = sampling_times(how["sampler"], how["steps"], how["abar"])[0]
    asked = replace(options(how, 0), clamp=None)
    x = sample(knows, shape, asked, x_T=q_sample(x_0, first, how["abar"], eps))
    torch.testing.assert_close(x, x_0, atol=1e-6, rtol=0)


@often
@given(settings_of_a_sampler(), shapes, seeds)
def test_without_fresh_noise_the_path_is_straight(how, shape, seed):
    """At every step the input is the clean dance under the noise that the first one had."""
    if how["sampler"] == "ddpm":
        how["sampler"] = "ddim"
    x_0, seen = clean(shape, seed).double(), []

    def perfect(x_t, t):
        a = abar_at(how["abar"], t)
        seen.append(((x_t - a**0.5 * x_0) / (1 - a) ** 0.5, (1 - a) ** 0.5))
        return x_0

    x_T = gaussian(shape, generator=generator(seed), dtype=torch.float64)
    sample(perfect, shape, options(how, 0), x_T=x_T)
    first, _ = seen[0]
    for eps, size in seen:
        torch.testing.assert_close(eps, first, atol=1e-9 / size, rtol=0)


@settings(often, max_examples=30)
@given(settings_of_a_sampler(), etas, seeds)
def test_the_input_has_the_noise_of_its_step(how, eta, seed):
    """However much is fresh, it stays a normal distribution of the right width around x_0."""
    shape, seen = (1, 1, 100, 40), []
    x_0 = clean(shape, seed).double()

    def perfect(x_t, t):
        a = abar_at(how["abar"], t)
        seen.append((x_t - a**0.5 * x_0) / (1 - a) ** 0.5)
        return x_0

    g = generator(seed + 1)
    x_T = gaussian(shape, generator=g, dtype=torch.float64)
    sample(perfect, shape, options(how, eta), generator=g, x_T=x_T)
    assert len(seen) == len(sampling_times(how["sampler"], how["steps"], how["abar"])) - 1
    for eps in seen:
        assert float(eps.mean()) == pytest.approx(0, abs=0.1)  # a deviation is 0.016
        assert float(eps.std()) == pytest.approx(1, abs=0.07)  # a deviation is 0.011
        assert float((eps * x_0).mean()) == pytest.approx(0, abs=0.06)


@often
@given(st.sampled_from(SAMPLERS), st.integers(1, 1000), st.data())
def test_times_fall_to_clean(sampler, num_steps, data):
    steps = data.draw(st.integers(1, num_steps))
    times = sampling_times(sampler, steps, cosine_abar(num_steps))
    assert times[-1] == -1 and times[0] < num_steps
    assert all(later < t for t, later in pairwise(times))
    assert len(times) <= 1 + (num_steps if sampler == "ddpm" else steps)
    if sampler != "dpm":
        assert times[0] == num_steps - 1
        assert len(times) == 1 + (num_steps if sampler == "ddpm" else steps)


def imperfect(x_t, t):
    return torch.tanh(1.3 * x_t.flip(-1) + 0.1)


@often
@given(settings_of_a_sampler(), shapes, etas, seeds)
def test_a_seed_gives_the_same_bits(how, shape, eta, seed):
    def run(seed):
        return sample(
            imperfect,
            shape,
            options(how, eta),
            generator=generator(seed),
        )

    assert torch.equal(run(seed), run(seed))
    assert not torch.equal(run(seed), run(seed + 1))


@often
@given(settings_of_a_sampler(), st.integers(2, 4), etas, seeds, st.data())
def test_rows_do_not_depend_on_each_other(how, rows, eta, seed, data):
    def run(chosen):
        sources = [generator(seed + k) for k in chosen]
        return sample(
            imperfect,
            (len(chosen), 2, 5, 3),
            options(how, eta),
            generator=sources,
        )

    k = data.draw(st.integers(0, rows - 1))
    torch.testing.assert_close(run(range(rows))[k], run([k])[0], atol=1e-5, rtol=0)


@often
@given(settings_of_a_sampler(), shapes, st.sampled_from(MODES), seeds, st.data())
def test_the_network_sees_the_context(how, shape, mode, seed, data):
    k = data.draw(st.integers(0, shape[2]))
    known = clean((*shape[:2], k, shape[3]), seed)
    pin = Pinning(known, how["abar"], mode=mode, generator=generator(seed))
    seen = []

    def denoise(x_t, t):
        seen.append(x_t[:, :, :k])
        return imperfect(x_t, t)

    x_T = gaussian(shape, generator=generator(seed + 2))
    x = sample(denoise, shape, options(how, 1.0), pin=pin, generator=generator(seed + 1), x_T=x_T)
    assert x.isfinite().all() and x.abs().max() <= 1
    times = sampling_times(how["sampler"], how["steps"], how["abar"])
    if mode == "clean":
        assert all(torch.equal(x_t, known) for x_t in seen[1:])
    if mode == "same_noise":
        for x_t, t in zip(seen[1:], times[1:-1], strict=True):
            torch.testing.assert_close(x_t, q_sample(known, t, how["abar"], x_T[:, :, :k]))


@often
@given(shapes, seeds, st.floats(1e-6, 1 - 1e-6), st.floats(0.01, 10))
def test_what_is_bent_meets_its_constraint(shape, seed, abar, width):
    _, n, f, d = shape
    x, value = (torch.randn(shape, generator=generator(seed + k)) for k in (0, 1))
    mask = torch.rand(n, f, d, generator=generator(seed + 2)) < 0.3
    std = width / (1 + torch.arange(f)[:, None].repeat(1, d))
    conditioned = Constraint(mask, value[0]).condition(x, abar, std)
    fixed = mask.expand(shape)
    torch.testing.assert_close(conditioned[fixed], value[0].expand(shape)[fixed], atol=1e-3, rtol=0)
    free = ~mask.any(1, keepdim=True).expand(n, f, d).expand(shape)
    assert torch.equal(
        conditioned[free], x[free]
    )  # dancers without a constraint on a feature keep it
