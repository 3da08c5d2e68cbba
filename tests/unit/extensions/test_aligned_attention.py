import pytest
import torch

from dancediff.extensions.aligned_attention import align, align_attention
from dancediff.extensions.build import build
from dancediff.nn.attention import Attention
from dancediff.nn.decoder import DecoderLayer
from dancediff.papers.lodge.global_diffusion import GlobalConfig
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.papers.lodge.model import Lodge, LodgeConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig


@pytest.mark.parametrize("seed", range(3))
def test_aligned_heads_start_at_their_own_frame(seed):
    torch.manual_seed(seed)
    attend = Attention(128, num_heads=4)
    align(attend)
    x, memory = torch.randn(2, 150, 128), torch.randn(2, 150, 128)
    frames = torch.arange(150)
    weights = attend.weights(x, memory, frames, frames)
    own = (weights.argmax(-1) - frames).abs() <= 3  # a tenth of a second
    assert own[:, :2].float().mean() > 0.95
    near = (frames[:, None] - frames).abs() <= 10
    assert (weights[:, :2] * near).sum(-1).mean() > 0.6
    assert own[:, 2:].float().mean() < 0.2  # the other heads are free


def test_cross_attention_is_aligned_and_nothing_else():
    model = TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=2, ff_dim=32, fusion_hidden=32))
    before = {name: value.clone() for name, value in model.state_dict().items()}
    align_attention(model)
    changed = {n for n, value in model.state_dict().items() if not torch.equal(value, before[n])}
    layers = (f"decoder.sequence_decoder.layers.{k}.cross_attention" for k in range(2))
    assert changed == {f"{at}.{part}.bias" for at in layers for part in ("query", "key_value")}


@pytest.mark.parametrize("names", [(), ("aligned_attention",)])
def test_both_stages_of_lodge_start_aligned_if_asked(names):
    sizes = {"d_model": 64, "num_layers": 1, "ff_dim": 32}
    model = build(Lodge, LodgeConfig(GlobalConfig(**sizes), LocalConfig(**sizes)), names)
    frames, x = torch.arange(60), torch.zeros(1, 60, 64)
    for stage in (model.global_stage, model.local_stage):
        layers = [layer for layer in stage.modules() if isinstance(layer, DecoderLayer)]
        assert layers
        for layer in layers:
            own = layer.cross_attention.weights(x, x, frames, frames)[0, 0].argmax(-1) == frames
            assert own.all() == bool(names)
