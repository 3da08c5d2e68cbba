"""Hooks on the guesses of local segments: hard cues as a constraint, and the way back."""

import pytest
import torch

from dancediff.diffusion.samplers import SamplerOptions, sample, sampling_times
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.cue_constraint import cue_constraint
from dancediff.motion.representation import LODGE
from dancediff.papers.lodge.cue_guidance import CueGuidance

ABAR, SHAPE = cosine_abar(), (2, 64, LODGE.dim)
STD = (1 / (1 + torch.arange(64.0)[:, None]) ** 2).expand(64, LODGE.dim)


def guidance():
    """Hard cues at both borders; every value is 0.8."""
    hard = torch.zeros(SHAPE[:2], dtype=torch.bool)
    hard[:, :4] = hard[:, -4:] = True
    y = torch.full(SHAPE, 0.8)
    return CueGuidance(y, hard, ~hard & False, ABAR, sampling_times("ddim", 10), soft=1.0)


def dance(denoise, hooks=(), pin=None):
    g = torch.Generator().manual_seed(0)
    return sample(
        denoise, SHAPE, SamplerOptions(ABAR, "ddim", 10, eta=1.0), generator=g, pin=pin, hooks=hooks
    )


def edge(x):
    """Largest step where cues end, over the largest step in between."""
    step = x[:, :, 7:].diff(dim=1).abs()
    return step[:, [3, -4]].max() / step[:, 24:36].max().clamp_min(1e-3)


def test_a_dance_meets_its_borders_without_a_jump():
    still, pin = torch.zeros_like, guidance()
    pasted = dance(lambda x, t: still(x), pin=pin)
    hooks = [cue_constraint(pin.hard, pin.y, STD)]
    conditioned = dance(lambda x, t: still(x), hooks, pin)
    assert pasted[:, :, 7:].diff(dim=1).abs().max() == pytest.approx(0.8)
    assert conditioned[:, :, 7:].diff(dim=1).abs().max() < 0.2
    assert edge(conditioned) < edge(pasted) / 4


def test_the_root_and_a_guess_that_is_right_stay():
    pin = guidance()
    hook, x = cue_constraint(pin.hard, pin.y, STD), torch.randn(SHAPE)
    conditioned = hook.apply(x, 0.5)
    torch.testing.assert_close(conditioned[..., LODGE.root], x[..., LODGE.root])
    assert (conditioned - x)[..., 7:].abs().max() > 0.1
    torch.testing.assert_close(hook.apply(pin.y, 0.5), pin.y)
