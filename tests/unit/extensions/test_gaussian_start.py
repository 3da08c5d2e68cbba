"""A sampler that begins with guesses of a Gaussian ends in the middle of the data, not short of it.

The data: places like those at the side of a stage, 1.8 m from its middle for all of a window's 150
frames, which is 22 in the lowest frequency, and a quarter of a metre more or less.
"""

import math

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.samplers import (
    GAUSSIAN_STEPS,
    SamplerOptions,
    gaussian_end,
    sample,
)
from dancediff.diffusion.schedule import abar_at, cosine_abar
from dancediff.extensions.gaussian_start import started_by_gaussian
from dancediff.extensions.preconditioning import linear_denoiser
from dancediff.generation.group_dance import binder
from tiny_tcdiffpp import tiny_tcdiffpp

ABAR = cosine_abar()
MEAN, STD = 22.0, 3.0


def exact(x_t, t):
    """The best guess of normally distributed places."""
    a = abar_at(ABAR, t)
    return MEAN + math.sqrt(a) * STD**2 / (a * STD**2 + 1 - a) * (x_t - math.sqrt(a) * MEAN)


def places(gaussian_start: bool) -> torch.Tensor:
    options = SamplerOptions(ABAR, "dpm", 6, 0.0, None, 0.07, gaussian_start=gaussian_start)
    generator = torch.Generator().manual_seed(0)
    return sample(exact, (4000, 1, 1, 1), options, generator=generator)


def test_places_are_as_far_out_as_in_the_data_and_vary_as_much():
    x = places(gaussian_start=True)
    assert x.mean().item() == pytest.approx(MEAN, abs=0.05 * STD)
    assert x.std().item() == pytest.approx(STD, rel=0.05)


def test_without_it_they_are_nearer_to_the_middle():
    assert places(gaussian_start=False).mean() < MEAN - 0.15 * STD


@pytest.mark.parametrize("steps", [1, 4, 6, 12])
def test_a_network_is_asked_as_often_as_steps_say(steps):
    options = SamplerOptions(ABAR, "dpm", steps, 0.0, None, 0.07, gaussian_start=True)
    asked, linear = [], []
    guess = started_by_gaussian(
        lambda x_t, t: (asked.append(t), exact(x_t, t))[1],
        lambda x_t, t: (linear.append(t), exact(x_t, t))[1],
        ABAR,
    )
    sample(guess, (1, 1, 1, 1), options, generator=torch.Generator().manual_seed(0))
    assert len(asked) == options.network_guesses() == steps and asked[0] == gaussian_end(ABAR)
    assert linear[0] == len(ABAR) - 1 and 2 <= len(linear) <= GAUSSIAN_STEPS
    assert linear + asked == options.times()[:-1]


def test_a_network_that_is_asked_for_it_guesses_linearly_before():
    model = tiny_tcdiffpp(("preconditioning",)).model
    x_t = torch.randn(1, 2, 150, 151, generator=torch.Generator().manual_seed(0))
    given = Conditions(torch.zeros(1, 150, 35), swap=torch.tensor([[1, 0]]))
    end = gaussian_end(model.abar)
    with torch.inference_mode():
        guess = binder(model, 1.0, 1.3, gaussian_start=True)(given)
        plain = binder(model, 1.0, 1.3)(given)
        linear = linear_denoiser(model, given)(x_t, end + 1)
        assert torch.equal(guess(x_t, end + 1), linear)
        assert not torch.equal(plain(x_t, end + 1), linear)
        assert torch.equal(guess(x_t, end), plain(x_t, end))
