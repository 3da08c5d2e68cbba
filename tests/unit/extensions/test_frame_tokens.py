"""Frame tokens against what they say of themselves."""

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.extensions.frame_tokens import FRAMES, FrameTokens
from dancediff.extensions.lodge_stages import ExtendedLocalDenoiser
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

SIZES = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "num_frames": 30}


def test_a_frame_changes_its_own_token_alone():
    tokens, h = FrameTokens(8), torch.randn(2, 3, 12, 8)
    other = h.clone()
    other[:, :, 4] += 1
    changed = (tokens.pool(other) != tokens.pool(h)).any(-1).any(0).any(0)
    assert changed.tolist() == [k == 4 // FRAMES for k in range(12 // FRAMES)]


def test_a_token_changes_its_own_frames_alone():
    tokens, h = FrameTokens(8), torch.randn(2, 3, 12, 8)
    low = tokens.pool(h)
    other = low.clone()
    other[:, :, 2] += 1
    changed = (tokens.unpool(other, h) != tokens.unpool(low, h)).any(-1).any(0).any(0)
    assert changed.nonzero().flatten().tolist() == [6, 7, 8]


def test_details_of_a_frame_reach_that_frame():
    tokens, h = FrameTokens(8), torch.randn(2, 3, 12, 8)
    low, other = tokens.pool(h), h.clone()
    other[:, :, 7] += 1
    changed = (tokens.unpool(low, other) != tokens.unpool(low, h)).any(-1).any(0).any(0)
    assert changed.nonzero().flatten().tolist() == [7]


@pytest.mark.parametrize(("kind", "config"), [(TCDiffPP, TCDiffPPConfig), (EDGE, EDGEConfig)])
def test_networks_hear_music_in_the_same_tokens(kind, config):
    model = build(kind, config(**SIZES), ["frame_tokens", "beat_phase"]).eval()
    x, t = torch.randn(2, 3, 30, 151), torch.tensor([10, 900])
    conditions = Conditions(torch.randn(2, 30, 35), swap=torch.arange(3).expand(2, 3))
    guess = model.denoise(x, t, conditions)
    assert guess.shape == x.shape and guess.isfinite().all()
    assert model.decoder.music(conditions.music).shape == (2, 30 // FRAMES, 16)
    some = Conditions(conditions.music[:, :20], swap=conditions.swap)
    assert model.denoise(x[:, :, :20], t, some).shape == (2, 3, 20, 151)


def test_layers_have_a_third_of_the_tokens():
    model, seen = build(TCDiffPP, TCDiffPPConfig(**SIZES), ["frame_tokens"]), []
    layer = model.decoder.sequence_decoder.layers[0]
    layer.register_forward_pre_hook(lambda module, args: seen.append(args[0].shape))
    conditions = Conditions(torch.randn(2, 30, 35), swap=torch.arange(3).expand(2, 3))
    model.denoise(torch.randn(2, 3, 30, 151), torch.tensor([10, 900]), conditions)
    assert seen == [(2, 3, 10, 16)]


def test_lodges_local_stage_has_tokens_of_three_frames_too_and_its_foot_block_sees_each_frame():
    config = LocalConfig(**SIZES | {"num_frames": 32})  # a last token that is not whole
    model, seen = ExtendedLocalDenoiser(config, ["frame_tokens"]).eval(), []
    for part in (model.decoder.layers[0], model.foot_refine):
        part.register_forward_pre_hook(lambda _, args: seen.append(args[0].shape[:2]))
    style = model.style(torch.tensor([0, 3]), torch.randn(2, config.style_noise))
    conditions = Conditions(torch.randn(2, 32, 35), style=style)
    guess = model.denoise(torch.randn(2, 32, 139), torch.tensor([10, 900]), conditions)
    assert guess.shape == (2, 32, 139) and guess.isfinite().all()
    assert seen == [(2, 11), (2, 32)]
    assert model.decoder.music(conditions.music).shape == (2, 11, 16)
