import json
from dataclasses import asdict

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.guidance import guided
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.build import build
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.papers.tcdiffpp.footwork_adaptor import ground_velocity
from dancediff.papers.tcdiffpp.losses import tcdiffpp_losses
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig


def network_inputs(x):
    x_t, t, M, S = x
    return x_t, t, Conditions(M, S)


PACKAGED = (
    *("ssd", "aligned_attention", "footwork_residual", "formation_prior"),
    *("preconditioning", "foot_cues", "beat_phase", "non_local_filter"),
)


def make(extensions=(), **options):
    torch.manual_seed(0)
    sizes = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "fusion_hidden": 48}
    return build(TCDiffPP, TCDiffPPConfig(**sizes | {} | options), extensions).eval()


def inputs(b=2, n=3, f=20):
    torch.manual_seed(1)
    x_t, M = torch.randn(b, n, f, 151), torch.randn(b, f, 35)
    return x_t, torch.randint(1000, (b,)), M, torch.arange(n).expand(b, n)


def test_footwork_is_the_last_step():
    model, x = make(), inputs()
    for layer in model.footwork_adaptor.layers:  # zeros at first: the velocity is not heard
        torch.nn.init.normal_(layer.shift.weight)
    x_raw, x_hat = model(*network_inputs(x))
    torch.testing.assert_close(x_raw, model.decoder(*network_inputs(x)))
    adapted = model.footwork_adaptor(x_raw, ground_velocity(x_raw))
    torch.testing.assert_close(x_hat, adapted)
    assert (x_hat - x_raw).abs().max() > 0.1


def test_footwork_corrects_no_more_than_noise_can_hide():
    """The correction has the size of what the linear guess misses, at every level of noise."""
    model, (x_t, _, M, S) = make(["preconditioning", "footwork_residual"]), inputs(f=40)
    known = preconditioning_of(model)
    known.std[5:] = 2e-4  # data move slowly
    torch.nn.init.normal_(model.footwork_adaptor.adaptor.layers[2].linear.weight)
    missed, corrected = [], []
    for step in (2, 20, 200):
        t = torch.full((2,), step)
        x_raw, x_hat = model(x_t, t, Conditions(M, S))
        added = (x_hat - x_raw)[..., model.footwork_adaptor.adaptor.channels]
        missed.append(known.error(model.abar[t].float())[0].sqrt())
        corrected.append(added.square().mean().sqrt())
        assert (added.diff(dim=2).abs().mean() < 0.2 * added.abs().mean()).all()
    small, middle, large = torch.stack(corrected) / torch.stack(missed)
    assert corrected[0] < corrected[1] < corrected[2]
    assert 0.5 < small / middle < 2 and 0.3 < large / middle < 2
    unscaled = (
        model.footwork_adaptor(x_raw, ground_velocity(x_raw)) - x_raw
    )  # as it was: the same at t = 2 as at t = 200
    assert unscaled.square().mean().sqrt() > 10 * corrected[0]


@pytest.mark.parametrize("extensions", [(), PACKAGED], ids=["plain", "packaged"])
@pytest.mark.parametrize("bfloat16", [False, True])
def test_gradient_reaches_every_parameter(extensions, bfloat16):
    model, (x_t, t, M, S) = make(extensions, num_layers=2).train(), inputs(n=5)
    if extensions:  # the filter starts at zero, which stops the gradient of its weights
        torch.nn.init.normal_(model.parts["non_local_filter"].mix.weight)
    keep = torch.tensor([True, False])
    with torch.autocast("cpu", torch.bfloat16, enabled=bfloat16):
        x_raw, x_hat = model(x_t, t, Conditions(M, S, music_mask=keep))
    (x_raw.square().mean() + x_hat.square().mean()).backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.isfinite().all() and parameter.grad.abs().max() > 0, name


@pytest.mark.parametrize("extensions", [(), PACKAGED], ids=["plain", "packaged"])
def test_bfloat16_autocast_is_close_to_float32(extensions):
    model, x = make(extensions, d_model=32), inputs(f=60)
    _, plain = model(*network_inputs(x))
    with torch.autocast("cpu", torch.bfloat16):
        _, fast = model(*network_inputs(x))
    assert fast.dtype == torch.float32
    assert (fast - plain).square().mean().sqrt() < 0.02 * plain.std()


def test_guidance_1_is_the_conditional_prediction():
    model, (x_t, _, M, S) = make(), inputs()

    conditional = model(x_t, torch.full((2,), 500), Conditions(M, S))[1]
    torch.testing.assert_close(guided(model.denoise, Conditions(M, S), 1.0)(x_t, 500), conditional)
    # the batched pass: x_u + w (x_c - x_u), just above w = 1
    almost = guided(model.denoise, Conditions(M, S), 1.0 + 1e-6)(x_t, 500)
    torch.testing.assert_close(almost, conditional, atol=1e-4, rtol=1e-4)


def test_music_that_was_dropped_cannot_matter_to_guidance_0():
    model, (x_t, _, M, S) = make(), inputs()

    def run(M):
        return guided(model.denoise, Conditions(M, S), 0.0)(x_t, 500)

    assert torch.equal(run(M), run(-M))


def test_state_holds_normalisers_but_no_schedule():
    state = make().state_dict()
    assert {"normalizer.low", "normalizer.high", "music_normalizer.mean"} <= set(state)
    assert not [name for name in state if "abar" in name or "channels" in name]
    model = make()
    torch.testing.assert_close(model.abar, cosine_abar(1000))
    state["normalizer.high"] += 1
    model.load_state_dict(state)
    assert model.normalizer.high[0] == 2


@pytest.mark.parametrize("config", [TCDiffPPConfig(), TCDiffPPConfig.paper(max_dancers=2)])
def test_config_survives_json(config):
    assert TCDiffPPConfig(**json.loads(json.dumps(asdict(config)))) == config


@pytest.mark.parametrize("max_dancers, millions", [(2, 68.3), (3, 69.3), (4, 70.4), (5, 71.4)])
def test_paper_size(max_dancers, millions):
    """Parameter counts of the published sizes, worked out by hand from the layer widths."""
    with torch.device("meta"):
        model = TCDiffPP(TCDiffPPConfig.paper(max_dancers=max_dancers))
    count = sum(p.numel() for p in model.parameters()) / 1e6
    assert count == pytest.approx(millions, abs=0.06)


@pytest.mark.parametrize(
    "sizes", [{"d_model": 0}, {"num_layers": 10**9}, {"ff_dim": -1}, {"max_dancers": 0}]
)
def test_sizes_that_no_network_has_are_refused(sizes):
    with pytest.raises(ValueError, match=rf"{next(iter(sizes))}=.* must lie in 1 \.\.\."):
        TCDiffPPConfig(**sizes)


def test_gradients_can_be_checked_in_double():
    """Of the whole network, losses included: x_t against differences of the loss."""
    torch.manual_seed(0)
    sizes = {"d_model": 8, "num_heads": 2, "num_layers": 1, "ff_dim": 8, "fusion_hidden": 8}
    model = TCDiffPP(TCDiffPPConfig(**sizes, footwork_hidden=8)).double()
    x_0, t = torch.rand(1, 2, 3, 151).double(), torch.tensor([7])
    conditions = Conditions(torch.randn(1, 3, 35).double(), swap=torch.arange(2)[None])

    def loss(x_t):
        return tcdiffpp_losses(*model(x_t, t, conditions), x_0, model.normalizer)["total"]

    x_t = torch.randn(1, 2, 3, 151).double().requires_grad_()
    assert torch.autograd.gradcheck(loss, x_t, fast_mode=True)
