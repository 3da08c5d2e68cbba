"""Table 4 of TCDiff++: what ``without`` names is gone, and nothing else changes."""

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.papers.tcdiffpp.losses import LossWeights, tcdiffpp_losses
from dancediff.papers.tcdiffpp.model import COMPONENTS, TCDiffPP, TCDiffPPConfig

SIZES = {"d_model": 16, "num_heads": 2, "num_layers": 2, "ff_dim": 32, "fusion_hidden": 48}
D, PLACES = 16, 5


def make(*without):
    torch.manual_seed(0)
    return TCDiffPP(TCDiffPPConfig(**SIZES, without=without)).eval()


def inputs(n=3, f=12):
    g = torch.Generator().manual_seed(1)
    x_t, M = torch.randn(1, n, f, 151, generator=g), torch.randn(1, f, 35, generator=g)
    return x_t, torch.tensor([300]), Conditions(M, torch.arange(n)[None])


def count(model):
    return sum(p.numel() for p in model.parameters())


def named(model, part):
    return sum(p.numel() for name, p in model.named_parameters() if part in name)


FUSION = (PLACES * D * 48 + 48) + (48 * 48 + 48) + (48 * PLACES * D + PLACES * D)
SWAP = PLACES * PLACES * D + D * D + D


@pytest.mark.parametrize(
    ("part", "size"),
    [
        ("dancer_positioning", PLACES * D),
        ("fusion_projection", FUSION),
        ("footwork_adaptor", 57_482),
        ("swap_mode", SWAP),
    ],
)
def test_a_part_is_gone_and_the_dance_is_another(part, size):
    full, without, x = make(), make(part), inputs()
    without.load_state_dict(full.state_dict(), strict=False)
    assert named(full, part) == size == count(full) - count(without)
    assert named(without, part) == 0
    assert (full.denoise(*x) - without.denoise(*x)).abs().max() > 1e-3


def test_without_a_state_space_model_its_block_is_gone():
    full, without = make(), make("ssm")
    block = count(full.decoder.sequence_decoder.layers[0].ssm)
    around = 2 * D + (D * 2 * D + 2 * D)  # its LayerNorm and FiLM
    assert named(without, "ssm") == 0 < named(full, "ssm")
    assert count(full) - count(without) == 2 * (block + around)


def only_the_state_crosses_frames(model):
    """Close every other way from one frame to another. FP and feed-forward have none."""
    for layer in model.decoder.sequence_decoder.layers:
        torch.nn.init.zeros_(layer.self_attention.out.weight)
    return model


@pytest.mark.parametrize("without", [(), ("ssm",)])
def test_the_state_remembers_the_past_and_knows_no_future(without):
    model, (x_t, *rest) = (
        only_the_state_crosses_frames(make("footwork_adaptor", *without)),
        inputs(),
    )
    other = x_t.clone()
    other[:, :, 7] += torch.randn(151)
    change = (model.denoise(other, *rest) - model.denoise(x_t, *rest)).abs().amax(dim=(0, 1, 3))
    assert change[7] > 1e-2 and change[:7].max() < 1e-6
    assert (change[8:].min() > 1e-6) == (not without)


def test_swap_mode_is_not_told_to_a_model_without_it():
    model, (x_t, t, conditions) = make("swap_mode"), inputs()
    other = Conditions(conditions.music, conditions.swap.flip(1))
    assert torch.equal(model.denoise(x_t, t, other), model.denoise(x_t, t, conditions))


def test_everything_can_be_left_out_at_once():
    x_raw, x_hat = make(*COMPONENTS)(*inputs())
    assert torch.equal(x_raw, x_hat) and x_raw.isfinite().all()


def test_unknown_components_are_named():
    with pytest.raises(ValueError, match="without: 'lstm' is not one of dancer_positioning"):
        make("lstm")


def test_distance_weight_zero_takes_the_term_out_of_the_gradient():
    model = make()
    x_0 = torch.rand(1, 3, 6, 151, generator=torch.Generator().manual_seed(0))

    def gradient(**weights):
        guess = (x_0.flip(1) * 0.9).requires_grad_()
        terms = tcdiffpp_losses(guess, guess, x_0, model.normalizer, weights=LossWeights(**weights))
        terms["total"].backward()
        return guess.grad, terms

    without, terms = gradient(dist=0.0)
    full, _ = gradient()
    assert terms["dist"] > 0
    extra = full - without
    root = torch.zeros(151, dtype=torch.bool)
    root[4:7] = True
    assert (extra[..., root] != 0).any() and extra[..., ~root].abs().max() < 1e-7
