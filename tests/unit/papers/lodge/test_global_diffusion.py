"""The first stage, plain and with extensions."""

import json
from dataclasses import asdict

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.guidance import guided
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.papers.lodge.global_diffusion import (
    GlobalConfig,
    GlobalDenoiser,
    global_token_frames,
)
from tiny_lodge import tiny_lodge

OURS = ("preconditioning", "style_film", "global_style")


def make(extensions=OURS, **sizes):
    return tiny_lodge(extensions, first=sizes).global_stage


def inputs(model, b=2):
    torch.manual_seed(1)
    c, style = model.config, None
    x_t, M = torch.randn(b, c.num_frames, 139), torch.randn(b, c.music_frames, 35)
    if model.style is not None:
        style = model.style(torch.arange(b), torch.randn(b, 64))
    return x_t, torch.tensor([20, 800])[:b], Conditions(M, style=style)


@pytest.mark.parametrize(
    ("N", "n", "frames"), [(1024, 512, 56), (1024, 256, 104), (1024, 128, 200), (512, 256, 56)]
)
def test_sizes_of_table_7(N, n, frames):
    config = GlobalConfig(music_frames=N, local_frames=n)
    assert config.num_frames == frames == 8 * ((N // n + 1) + 2 * (N // n))
    assert len(global_token_frames(config)) == frames


def test_tokens_stand_where_they_are_danced():
    starts = global_token_frames(GlobalConfig()).reshape(13, 8)[:, 0].tolist()
    hard, soft = starts[::3], [s for k, s in enumerate(starts) if k % 3]
    assert hard == [0, 252, 508, 764, 1016]  # 8 frames about each border; whole at both ends
    assert soft == [60, 188, 316, 444, 572, 700, 828, 956]
    assert (global_token_frames(GlobalConfig()).reshape(13, 8).diff() == 1).all()
    assert global_token_frames(GlobalConfig(variant="discrete")).tolist() == list(range(0, 1024, 4))


@pytest.mark.parametrize("extensions", [(), OURS, ("preconditioning",), ("global_style",)], ids=str)
@pytest.mark.parametrize("sizes", [{}, {"pool": 4}, {"variant": "discrete"}], ids=str)
def test_every_switch_runs_and_learns(extensions, sizes):
    model = make(extensions, **sizes).train()
    x_t, t, conditions = inputs(model)
    y = model(x_t, t, conditions.with_mask(torch.tensor([True, False])))
    assert y.shape == x_t.shape
    y.square().sum().backward()
    assert all(p.grad.isfinite().all() for p in model.parameters())
    still = [name for name, p in model.named_parameters() if not p.grad.any()]
    heads = ("style.mapping.heads.0.", "style.mapping.heads.1.")  # of the genres that are asked for
    assert all(n.startswith("style.mapping.heads.") and not n.startswith(heads) for n in still)


def test_without_extensions_it_is_the_papers():
    assert type(make(())) is GlobalDenoiser
    assert not make(("beat_phase",)).parts  # which is for the second stage


def test_every_primitive_has_a_spectrum_of_its_own_length():
    model = make()
    spectrum = preconditioning_of(model)
    assert spectrum.std.shape == (8, 139)
    x = torch.randn(50, 104, 139)
    x = x + 5 * torch.randn(50, 13, 1, 139).expand(50, 13, 8, 139).flatten(1, 2)  # apart by 5
    spectrum.fit([model.clips(x).flatten(0, 1)])
    assert spectrum.std[0].mean() > 5 * 8**0.5 * 0.9
    torch.testing.assert_close(spectrum.std[1:].mean(), torch.tensor(1.0), atol=0.1, rtol=0)
    assert preconditioning_of(make(variant="discrete")).std.shape == (64, 139)
    assert preconditioning_of(make(())) is None


def test_what_a_primitive_is_guessed_to_be_without_a_network_is_its_own_affair():
    model = make()
    for weights in model.decoder.out.parameters():
        torch.nn.init.zeros_(weights)
    x_t, t, conditions = inputs(model)
    other = x_t.clone()
    other[:, 8:] += 1
    a, b = model(x_t, t, conditions), model(other, t, conditions)
    torch.testing.assert_close(a[:, :8], b[:, :8])
    assert (a[:, 8:] - b[:, 8:]).abs().min() > 0
    torch.testing.assert_close(model.linear_guess(x_t, t, conditions), a)


@pytest.mark.parametrize("extensions", [(), OURS], ids=str)
def test_music_matters_and_dropped_music_does_not(extensions):
    model = make(extensions)
    x_t, t, conditions = inputs(model)
    other = Conditions(conditions.music.flip(1), style=conditions.style)
    y, none = model(x_t, t, conditions), torch.zeros(2, dtype=torch.bool)
    assert (model(x_t, t, other) - y).abs().max() > 1e-4
    a, b = (model(x_t, t, c.with_mask(none)) for c in (conditions, other))
    torch.testing.assert_close(a, b)


@pytest.mark.parametrize("film", [True, False])
def test_the_genre_matters_with_music_and_without(film):
    model = make(("style_film", "global_style") if film else ("global_style",))
    x_t, t, conditions = inputs(model)
    z = torch.randn(1, 64).expand(2, -1)
    styles = [model.style(torch.full((2,), genre), z) for genre in (0, 6)]
    for mask in (None, torch.zeros(2, dtype=torch.bool)):
        a, b = (model(x_t, t, Conditions(conditions.music, None, s, mask)) for s in styles)
        assert (a - b).abs().max() > 1e-4


def test_guidance_takes_it():
    model = make()
    x_t, _, conditions = inputs(model)
    same = model(x_t, torch.full((2,), 300), conditions)
    torch.testing.assert_close(guided(model.denoise, conditions, 1.0)(x_t, 300), same)


def test_config_survives_json():
    config = GlobalConfig(pool=2)
    assert GlobalConfig(**json.loads(json.dumps(asdict(config)))) == config


def test_errors():
    with pytest.raises(ValueError, match="variant='dotted'"):
        GlobalConfig(variant="dotted")
    with pytest.raises(ValueError, match="local_frames=200 must divide music_frames=1024"):
        GlobalConfig(local_frames=200)
    with pytest.raises(ValueError, match="every=3 must divide music_frames=1024"):
        GlobalConfig(variant="discrete", every=3)
    model = make()
    x_t, t, c = inputs(model)
    for name, arguments in {
        "x_t": (x_t[:, :-1], t, c),
        "t": (x_t, t[:1], c),
        "music": (x_t, t, Conditions(c.music[:, :-1], style=c.style)),
        "style": (x_t, t, Conditions(c.music)),
    }.items():
        with pytest.raises(ValueError, match=f"^{name} has shape"):
            model(*arguments)
    with pytest.raises(ValueError, match=r"^style has shape"):
        make(())(x_t, t, c)


@pytest.mark.parametrize("extensions", [(), OURS], ids=str)
def test_layers_know_where_tokens_are_danced(extensions):
    model, seen = make(extensions), []
    model.decoder.layers[0].register_forward_pre_hook(lambda layer, args: seen.append(args[3]))
    model(*inputs(model))
    assert torch.equal(seen[0], global_token_frames(model.config))


def test_a_token_gets_the_energy_of_the_frame_that_it_stands_for():
    model = make(("preconditioning", "energy_condition"))
    x_t, t, conditions = inputs(model)
    curve = torch.rand(2, model.config.music_frames)
    run = model.prepare(x_t, t, Conditions(conditions.music, energy=curve))
    assert torch.equal(run.conditions.energy, curve[:, global_token_frames(model.config).long()])
