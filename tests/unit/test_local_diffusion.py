import json
from dataclasses import asdict

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.motion.representation import Normalizer
from dancediff.papers.lodge.foot_refine import joints_of
from dancediff.papers.lodge.local_diffusion import LocalConfig, LocalDenoiser


def network_inputs(x):
    x_t, t, M, style = x
    return x_t, t, Conditions(M, style=style)


def make(**options):
    torch.manual_seed(0)
    sizes = {"d_model": 16, "num_heads": 2, "num_layers": 2, "ff_dim": 32, "num_frames": 20}
    return LocalDenoiser(LocalConfig(**sizes | options)).eval()


def inputs(model, b=2):
    torch.manual_seed(1)
    f = model.config.num_frames
    style = model.style(torch.arange(b), torch.randn(b, model.config.style_noise)).detach()
    return torch.randn(b, f, 139), torch.tensor([20, 800])[:b], torch.randn(b, f, 35), style


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"foot_refine": False},
        {"precondition": False},
        {"style": "embedding"},
        {"style_film": False},
        {"genres": ("waltz", "tango")},
        {"beat_waves": True, "non_local": True},
    ],
    ids=str,
)
def test_every_switch_runs_and_learns(options):
    model = make(**options).train()
    if model.non_local is not None:  # starts at zero, which stops the gradient of its weights
        torch.nn.init.normal_(model.non_local.mix.weight)
    x_t, t, M, _ = inputs(model)
    style = model.style(torch.tensor([0, 1]), torch.randn(2, 64))
    x_raw, x_hat = model(x_t, t, Conditions(M, style=style, music_mask=torch.tensor([True, False])))
    assert x_hat.shape == x_raw.shape == x_t.shape
    (x_raw.square().sum() + x_hat.square().sum()).backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in model.parameters())


def test_without_the_block_both_guesses_are_one():
    model = make(foot_refine=False)
    x_raw, x_hat = model(*network_inputs(inputs(model)))
    assert torch.equal(x_raw, x_hat)


def test_correction_is_small_before_training_and_not_nothing():
    for precondition in (True, False):
        model = make(precondition=precondition)
        x_raw, x_hat = model(*network_inputs(inputs(model)))
        assert 1e-6 < (x_hat - x_raw).abs().max() < 0.1


def test_feet_are_computed_in_metres():
    model = make()
    x, floor = torch.rand(1, 20, 139), 0.3
    physical = make(floor=floor)
    physical.normalizer = Normalizer(-2 * torch.ones(139), 3 * torch.ones(139))
    height = physical.feet(x).reshape(1, 20, 4, 4, 3)[:, :, 2, :, 1]
    _, _, joints = joints_of(physical.normalizer.unnormalize(x))
    torch.testing.assert_close(height, joints[..., (7, 8, 10, 11), 1] - floor)
    assert (model.feet(x) - physical.feet(x)).abs().max() > 0.1


def test_correction_keeps_to_the_spectrum_of_dance():
    model = make()
    model.precondition.spread.fill_(2e-4)  # data that hardly move
    model.precondition.spread[0] = 0.5
    for weights in model.foot_refine.out.parameters():
        weights.data.mul_(100)
    x_t, t, M, style = inputs(model)
    x_raw, x_hat = model(x_t, t, Conditions(M, style=style))
    delta = x_hat - x_raw
    assert delta.mean(1).abs().max() > 100 * delta.diff(dim=1).abs().max()


def test_style_is_heard_without_music_and_music_is_not():
    for film in (True, False):
        model = make(style_film=film)
        x_t, t, M, style = inputs(model)
        none = torch.zeros(2, dtype=torch.bool)
        y = model(x_t, t, Conditions(M, style=style, music_mask=none))[1]
        torch.testing.assert_close(
            model(x_t, t, Conditions(torch.randn_like(M), style=style, music_mask=none))[1], y
        )
        assert (
            model(x_t, t, Conditions(M, style=style.flip(0), music_mask=none))[1] - y
        ).abs().max() > 1e-4
        assert (model(x_t, t, Conditions(M, style=style))[1] - y).abs().max() > 1e-4


def test_rows_do_not_see_each_other():
    model = make()
    x_t, t, M, style = inputs(model)
    both = model(x_t, t, Conditions(M, style=style))[1]
    for k in range(2):
        one = slice(k, k + 1)
        alone = model(x_t[one], t[one], Conditions(M[one], style=style[one]))[1]
        torch.testing.assert_close(alone, both[one], atol=1e-5, rtol=1e-5)


def test_bfloat16_is_close():
    model = make()
    x = inputs(model)
    with torch.autocast("cpu", torch.bfloat16):
        y = model(*network_inputs(x))[1]
    assert y.dtype == torch.float32
    torch.testing.assert_close(y, model(*network_inputs(x))[1], atol=0.05, rtol=0.05)


def test_fitted_spectrum_is_reported():
    model, x = make(), torch.randn(40, 20, 139)
    model.fit_precondition([x[:10], x[10:]], weights=[1.0, 1.0])
    assert model.spread.shape == (20, 139)
    torch.testing.assert_close(model.spread[1:].mean(), torch.tensor(1.0), atol=0.05, rtol=0)
    assert make(precondition=False).spread is None


def test_config_survives_json():
    config = LocalConfig(genres=("a", "b"))
    assert LocalConfig(**json.loads(json.dumps(asdict(config)))) == config


def test_errors():
    for genres in ((), ("a", "a")):
        with pytest.raises(ValueError, match="genres="):
            LocalConfig(genres=genres)
    model = make()
    x_t, t, M, style = inputs(model)
    for name, arguments in {
        "x_t": (x_t[..., :-1], t, M, style),
        "t": (x_t, t[:1], M, style),
        "M": (x_t, t, M[:, :-1], style),
        "style": (x_t, t, M, style[:, :-1]),
    }.items():
        with pytest.raises(ValueError, match=f"^{name} has shape"):
            model(*network_inputs(arguments))


def test_beat_waves_are_heard_with_the_music_and_only_then():
    model = make(beat_waves=True)
    M = torch.zeros(2, 20, 35)
    M[0, [4, 12], 34] = 1  # the second song has no beat
    heard = model.hear_beats(M, torch.tensor([True, True]))
    assert heard[0].abs().amax(-1).min() > 0 and not heard[1].any()
    assert not model.hear_beats(M, torch.tensor([False, True])).any()
    assert make().hear_beats(M) is None
    assert not LocalConfig.paper().beat_waves


def test_beat_waves_reach_the_guess():
    model = make(beat_waves=True)
    x_t, t, M, style = inputs(model)
    before = model(x_t, t, Conditions(M, style=style))[1]
    with torch.no_grad():
        model.embed_beat.weight.zero_()
    assert (model(x_t, t, Conditions(M, style=style))[1] - before).abs().max() > 1e-5


def test_non_local_filter_needs_the_linear_guess_and_changes_the_raw_one():
    with pytest.raises(ValueError, match="non_local=True averages the linear guess"):
        make(non_local=True, precondition=False)
    model = make(non_local=True)
    x = inputs(model)
    before, _ = model(*network_inputs(x))
    torch.nn.init.normal_(model.non_local.mix.bias)
    after, _ = model(*network_inputs(x))
    assert (after - before).abs().amax((1, 2)).min() > 1e-3
