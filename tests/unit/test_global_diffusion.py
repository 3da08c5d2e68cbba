import json
from dataclasses import asdict

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.guidance import guided
from dancediff.papers.lodge.global_diffusion import GlobalConfig, GlobalDenoiser, token_frames

SMALL = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}


def network_inputs(x):
    x_t, t, M, style = x
    return x_t, t, Conditions(M, style=style)


def make(**options):
    torch.manual_seed(0)
    sizes = SMALL | {"music_frames": 64, "local_frames": 32}
    return GlobalDenoiser(GlobalConfig(**sizes | options)).eval()


def inputs(model, b=2):
    torch.manual_seed(1)
    c = model.config
    x_t, M = torch.randn(b, c.num_frames, 139), torch.randn(b, c.music_frames, 35)
    style = None
    if c.genres:
        style = model.style(torch.arange(b), torch.randn(b, c.style_noise)).detach()
    return x_t, torch.tensor([20, 800])[:b], M, style


@pytest.mark.parametrize(
    ("N", "n", "frames"), [(1024, 512, 56), (1024, 256, 104), (1024, 128, 200), (512, 256, 56)]
)
def test_sizes_of_table_7(N, n, frames):
    config = GlobalConfig(music_frames=N, local_frames=n)
    assert config.num_frames == frames == 8 * ((N // n + 1) + 2 * (N // n))
    assert len(token_frames(config)) == frames


def test_tokens_stand_where_they_are_danced():
    starts = token_frames(GlobalConfig()).reshape(13, 8)[:, 0].tolist()
    hard, soft = starts[::3], [s for k, s in enumerate(starts) if k % 3]
    assert hard == [0, 252, 508, 764, 1016]  # 8 frames about each border; whole at both ends
    assert soft == [60, 188, 316, 444, 572, 700, 828, 956]
    assert (token_frames(GlobalConfig()).reshape(13, 8).diff() == 1).all()
    assert token_frames(GlobalConfig(variant="discrete")).tolist() == list(range(0, 1024, 4))


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"pool": 4},
        {"genres": ()},
        {"precondition": False},
        {"variant": "discrete"},
        {"style": "embedding"},
        {"style_film": False},
    ],
    ids=str,
)
def test_every_switch_runs_and_learns(options):
    model = make(**options).train()
    x_t, t, M, _ = inputs(model)
    style = None
    if model.style is not None:
        style = model.style(torch.tensor([0, 3]), torch.randn(2, 64))
    y = model(x_t, t, Conditions(M, style=style, music_mask=torch.tensor([True, False])))
    assert y.shape == x_t.shape
    y.square().sum().backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in model.parameters())


def test_every_primitive_has_a_spectrum_of_its_own_length():
    model = make()
    assert model.spread.shape == (8, 139)
    x = torch.randn(50, 56, 139)
    x = x + 5 * torch.randn(50, 7, 1, 139).expand(50, 7, 8, 139).flatten(1, 2)  # apart by 5
    model.fit_precondition([x])
    assert model.spread[0].mean() > 5 * 8**0.5 * 0.9
    torch.testing.assert_close(model.spread[1:].mean(), torch.tensor(1.0), atol=0.1, rtol=0)
    assert make(variant="discrete").spread.shape == (16, 139)
    assert make(precondition=False).spread is None


def test_what_a_primitive_is_guessed_to_be_without_a_network_is_its_own_affair():
    model = make()
    for weights in model.trunk.out.parameters():
        torch.nn.init.zeros_(weights)
    x_t, t, M, style = inputs(model)
    other = x_t.clone()
    other[:, 8:] += 1
    a, b = model(x_t, t, Conditions(M, style=style)), model(other, t, Conditions(M, style=style))
    torch.testing.assert_close(a[:, :8], b[:, :8])
    assert (a[:, 8:] - b[:, 8:]).abs().min() > 0


def test_music_and_style_are_heard():
    model = make()
    x_t, t, M, style = inputs(model)
    y = model(x_t, t, Conditions(M, style=style))
    assert (model(x_t, t, Conditions(M.flip(1), style=style)) - y).abs().max() > 1e-4
    assert (model(x_t, t, Conditions(M, style=style.flip(0))) - y).abs().max() > 1e-4


def test_style_is_heard_without_music():
    model = make()
    x_t, t, M, style = inputs(model)
    none = torch.zeros(2, dtype=torch.bool)
    y = model(x_t, t, Conditions(M, style=style, music_mask=none))
    torch.testing.assert_close(
        model(x_t, t, Conditions(torch.randn_like(M), style=style, music_mask=none)), y
    )
    assert (
        model(x_t, t, Conditions(M, style=style.flip(0), music_mask=none)) - y
    ).abs().max() > 1e-4


def test_guidance_takes_it():
    model = make()
    x_t, _, M, style = inputs(model)
    denoise = guided(model.denoise, Conditions(M, style=style), 1.0)
    same = model(x_t, torch.full((2,), 300), Conditions(M, style=style))
    torch.testing.assert_close(denoise(x_t, 300), same)


def test_config_survives_json():
    config = GlobalConfig(genres=("a", "b"))
    assert GlobalConfig(**json.loads(json.dumps(asdict(config)))) == config


def test_errors():
    with pytest.raises(ValueError, match="variant='dotted'"):
        GlobalConfig(variant="dotted")
    with pytest.raises(ValueError, match="local_frames=200 must divide music_frames=1024"):
        GlobalConfig(local_frames=200)
    model = make()
    x_t, t, M, style = inputs(model)
    for name, arguments in {
        "x_t": (x_t[:, :-1], t, M, style),
        "t": (x_t, t[:1], M, style),
        "M": (x_t, t, M[:, :-1], style),
        "style": (x_t, t, M, None),
    }.items():
        with pytest.raises(ValueError, match=f"^{name} has shape"):
            model(*network_inputs(arguments))
    bare = make(genres=())
    with pytest.raises(ValueError, match=r"^style has shape"):
        bare(x_t, t, Conditions(M, style=style))
