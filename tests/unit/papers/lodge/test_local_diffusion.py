"""The second stage, plain and with extensions."""

import json
from dataclasses import asdict, replace

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import check_extensions
from dancediff.motion.representation import LODGE, Normalizer, joints_of
from dancediff.papers.lodge.local_diffusion import LocalConfig, LocalDenoiser
from dancediff.papers.lodge.model import Lodge
from tiny_lodge import tiny_lodge

OURS = ("preconditioning", "style_film", "beat_phase", "non_local_filter")


def make(extensions=OURS, **sizes):
    first = {"music_frames": 64, "local_frames": 64}  # of no interest here
    return tiny_lodge(extensions, first=first, second=sizes).local_stage


def inputs(model, b=2):
    torch.manual_seed(1)
    M = torch.randn(b, 64, 35)
    M[:, :, 33:] = 0
    M[:, ::15, 34] = 1
    style = model.style(torch.arange(b), torch.randn(b, model.config.style_noise)).detach()
    return torch.randn(b, 64, 139), torch.tensor([20, 800])[:b], Conditions(M, style=style)


@pytest.mark.parametrize(
    "extensions", [(), OURS, *[(name,) for name in OURS[:3]], (OURS[0], OURS[3])], ids=str
)
@pytest.mark.parametrize("foot_refine", [True, False])
def test_every_switch_runs_and_learns(extensions, foot_refine):
    model = make(extensions, foot_refine=foot_refine, genres=("waltz", "tango")).train()
    if "non_local_filter" in extensions:  # starts at zero, which stops the gradient of its weights
        torch.nn.init.normal_(model.parts.non_local_filter.mix.weight)
    x_t, t, conditions = inputs(model)
    style = model.style(torch.tensor([0, 1]), torch.randn(2, 64))
    conditions = replace(conditions, style=style, music_mask=torch.tensor([True, False]))
    x_raw, x_hat = model(x_t, t, conditions)
    assert x_hat.shape == x_raw.shape == x_t.shape
    (x_raw.square().sum() + x_hat.square().sum()).backward()
    assert all(p.grad.isfinite().all() and p.grad.any() for p in model.parameters())


def test_without_extensions_it_is_the_papers():
    assert type(make(())) is LocalDenoiser


def test_what_is_denoised_is_the_guess_with_refined_feet():
    model = make(())
    for weights in model.foot_refine.out.parameters():
        weights.data.mul_(100)
    x = inputs(model)
    x_raw, x_hat = model(*x)
    assert torch.equal(model.denoise(*x), x_hat) and (x_hat - x_raw).abs().max() > 0.1


def test_without_the_block_both_guesses_are_one():
    x_raw, x_hat = (model := make(foot_refine=False))(*inputs(model))
    assert torch.equal(x_raw, x_hat)


@pytest.mark.parametrize("extensions", [OURS, ()], ids=str)
def test_correction_is_small_before_training_and_not_nothing(extensions):
    model = make(extensions)
    x_raw, x_hat = model(*inputs(model))
    assert 1e-6 < (x_hat - x_raw).abs().max() < 0.1


def test_feet_are_computed_in_metres():
    model, physical = make(), make()
    x = torch.rand(1, 64, 139)
    physical.normalizer = Normalizer(-2 * torch.ones(139), 3 * torch.ones(139))
    height = physical.feet(x).reshape(1, 64, 4, 4, 3)[:, :, 2, :, 1]
    joints = joints_of(physical.normalizer.unnormalize(x), LODGE)
    torch.testing.assert_close(height, joints[..., (7, 8, 10, 11), 1])
    assert (model.feet(x) - physical.feet(x)).abs().max() > 0.1


def test_correction_keeps_to_the_spectrum_of_dance():
    model = make(("preconditioning",))
    std = model.parts.preconditioning.preconditioning.std
    std.fill_(2e-4)  # data that hardly move
    std[0] = 0.5
    for weights in model.foot_refine.out.parameters():
        weights.data.mul_(100)
    x_raw, x_hat = model(*inputs(model))
    delta = x_hat - x_raw
    assert delta.mean(1).abs().max() > 100 * delta.diff(dim=1).abs().max()


@pytest.mark.parametrize("extensions", [(), ("style_film",), OURS], ids=str)
def test_the_genre_matters_without_music_and_dropped_music_does_not(extensions):
    model = make(extensions)
    x_t, t, conditions = inputs(model)
    dropped = conditions.with_mask(torch.zeros(2, dtype=torch.bool))
    y = model.denoise(x_t, t, dropped)
    other = replace(dropped, music=torch.randn_like(dropped.music))
    torch.testing.assert_close(model.denoise(x_t, t, other), y)
    z = torch.randn(1, 64).expand(2, -1)
    for given in (conditions, dropped):
        a, b = (
            model.denoise(x_t, t, replace(given, style=model.style(torch.full((2,), g), z)))
            for g in (0, 6)
        )
        assert (a - b).abs().max() > 1e-4
    assert (model.denoise(x_t, t, conditions) - y).abs().max() > 1e-4


def test_rows_do_not_see_each_other():
    model = make()
    x_t, t, c = inputs(model)
    both = model.denoise(x_t, t, c)
    for k in range(2):
        one = slice(k, k + 1)
        alone = model.denoise(x_t[one], t[one], Conditions(c.music[one], style=c.style[one]))
        torch.testing.assert_close(alone, both[one], atol=1e-5, rtol=1e-5)


def test_bfloat16_is_close():
    model = make()
    x = inputs(model)
    with torch.autocast("cpu", torch.bfloat16):
        y = model.denoise(*x)
    assert y.dtype == torch.float32
    torch.testing.assert_close(y, model.denoise(*x), atol=0.05, rtol=0.05)


def test_config_survives_json():
    config = LocalConfig(genres=("a", "b"))
    assert LocalConfig(**json.loads(json.dumps(asdict(config)))) == config


def test_errors():
    for genres in ((), ("a", "a")):
        with pytest.raises(ValueError, match="genres="):
            LocalConfig(genres=genres)
    model = make()
    x_t, t, c = inputs(model)
    for name, arguments in {
        "x_t": (x_t[..., :-1], t, c),
        "t": (x_t, t[:1], c),
        "music": (x_t, t, replace(c, music=c.music[:, :-1])),
        "style": (x_t, t, replace(c, style=c.style[:, :-1])),
    }.items():
        with pytest.raises(ValueError, match=f"^{name} has shape"):
            model(*arguments)
    with pytest.raises(ValueError, match="'non_local_filter' needs 'preconditioning'"):
        check_extensions(Lodge, None, ["non_local_filter"])
    with pytest.raises(ValueError, match="'wings' is not one of those of Lodge"):
        check_extensions(Lodge, None, ["wings"])


def test_beat_phase_reaches_the_guess_with_the_music_and_only_then():
    model = make(("beat_phase",))
    x_t, t, conditions = inputs(model)
    mask = torch.tensor([True, False])
    before = model.denoise(x_t, t, conditions.with_mask(mask))
    with torch.no_grad():
        model.parts.beat_phase.embed_waves.weight.zero_()
    change = (model.denoise(x_t, t, conditions.with_mask(mask)) - before).abs().amax((1, 2))
    assert change[0] > 1e-5 and change[1] == 0


def test_non_local_filter_changes_the_raw_guess():
    model = make(("preconditioning", "non_local_filter"))
    x = inputs(model)
    before, _ = model(*x)
    torch.nn.init.normal_(model.parts.non_local_filter.mix.bias)
    after, _ = model(*x)
    assert (after - before).abs().amax((1, 2)).min() > 1e-3
