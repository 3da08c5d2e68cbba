"""Each switch of TCDiff++ takes its own part away, and changes what it should."""

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.papers.tcdiffpp.losses import LossWeights, tcdiffpp_losses
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

SIZES = {"d_model": 16, "num_heads": 2, "num_layers": 2, "ff_dim": 32, "fusion_hidden": 48}
D, PLACES = 16, 5


def network_inputs(x):
    x_t, t, M, S = x
    return x_t, t, Conditions(M, S)


def make(**options):
    torch.manual_seed(0)
    return TCDiffPP(TCDiffPPConfig(**SIZES | {"head_dim": 8} | options)).eval()


def inputs(n=3, f=12):
    g = torch.Generator().manual_seed(1)
    x_t, M = torch.randn(1, n, f, 151, generator=g), torch.randn(1, f, 35, generator=g)
    return x_t, torch.tensor([300]), M, torch.arange(n)[None]


def count(model):
    return sum(p.numel() for p in model.parameters())


def named(model, part):
    return sum(p.numel() for name, p in model.named_parameters() if part in name)


FUSION = (PLACES * D * 48 + 48) + (48 * 48 + 48) + (48 * PLACES * D + PLACES * D)
SWAP = PLACES * PLACES * D + D * D + D


@pytest.mark.parametrize(
    ("switch", "part", "size"),
    [
        ({"dpe": False}, "dpe", PLACES * D),
        ({"fp": False}, "fp", FUSION),
        ({"fa": False}, "footwork", 57_482),
        ({"swap_mode": False}, "swap_mode", SWAP),
    ],
)
def test_a_part_is_gone_and_the_dance_is_another(switch, part, size):
    full, without, x = make(), make(**switch), inputs()
    without.load_state_dict(full.state_dict(), strict=False)
    full.footwork.layers[2].linear.bias.data += 0.3  # it starts as nothing; give it something
    assert named(full, part) == size == count(full) - count(without)
    assert named(without, part) == 0
    assert (full(*network_inputs(x))[1] - without(*network_inputs(x))[1]).abs().max() > 1e-3


@pytest.mark.parametrize("ssm", ["mamba", "ssd"])
def test_without_a_state_space_model_its_block_is_gone(ssm):
    full, without = make(ssm=ssm), make(ssm="none")
    block = count(full.decoder.decoder.layers[0].ssm)
    around = 2 * D + (D * 2 * D + 2 * D)  # its LayerNorm and FiLM
    assert named(without, "ssm") == 0 < named(full, "ssm")
    assert count(full) - count(without) == 2 * (block + around)
    both = make(ssm=ssm, bidirectional=True)
    assert count(both) - count(full) == 2 * block


def only_the_state_crosses_frames(model):
    """Close every other way from one frame to another. FP and feed-forward have none."""
    for layer in model.decoder.decoder.layers:
        torch.nn.init.zeros_(layer.self_attention.out.weight)
    return model


@pytest.mark.parametrize("ssm", ["mamba", "ssd", "none"])
@pytest.mark.parametrize("bidirectional", [False, True])
def test_who_sees_the_future(ssm, bidirectional):
    options = {"ssm": ssm, "bidirectional": bidirectional, "precondition": False, "fa": False}
    model, (x_t, t, M, S) = only_the_state_crosses_frames(make(**options)), inputs()
    other = x_t.clone()
    other[:, :, 7] += torch.randn(151)
    change = (
        (model(other, t, Conditions(M, S))[1] - model(x_t, t, Conditions(M, S))[1])
        .abs()
        .amax(dim=(0, 1, 3))
    )
    assert change[7] > 1e-2
    assert (change[8:].min() > 1e-6) == (ssm != "none")  # the past is remembered
    assert (change[:7].max() > 1e-6) == (ssm != "none" and bidirectional)


def test_unknown_kinds_are_named():
    with pytest.raises(ValueError, match="ssm='lstm'"):
        make(ssm="lstm")
    with pytest.raises(ValueError, match="layer='edge'"):
        make(layer="edge")


@pytest.mark.parametrize("axis", ["pairs", "adjacent", "time"])
def test_distance_weight_zero_takes_the_term_out_of_the_gradient(axis):
    model = make()
    x_0 = torch.rand(1, 3, 6, 151, generator=torch.Generator().manual_seed(0))

    def gradient(**weights):
        guess = (x_0.flip(1) * 0.9).requires_grad_()
        terms = tcdiffpp_losses(guess, guess, x_0, model.normalizer, weights=LossWeights(**weights))
        terms["total"].backward()
        return guess.grad, terms

    without, terms = gradient(dist=0.0, dist_axis=axis)
    full, _ = gradient(dist_axis=axis)
    assert terms["dist"] > 0
    extra = full - without
    root = torch.zeros(151, dtype=torch.bool)
    root[4:7] = True
    assert (extra[..., root] != 0).any() and extra[..., ~root].abs().max() < 1e-7
