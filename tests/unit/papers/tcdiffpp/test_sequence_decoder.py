import pytest
import torch
from einops import rearrange

from dancediff.papers.tcdiffpp.sequence_decoder import (
    GroupDanceLayer,
    GroupDanceLayerWithoutSSM,
    SequenceDecoder,
    token_frames,
)


def make(**options):
    torch.manual_seed(0)
    return SequenceDecoder(16, num_layers=2, num_heads=2, ff_dim=32, **options)


@pytest.mark.parametrize("with_ssm", [True, False])
def test_both_kinds_of_layer_run(with_ssm):
    h = torch.randn(2, 3, 6, 16)
    y = make(with_ssm=with_ssm)(h, torch.randn(2, 9, 16), torch.randn(2, 16))
    assert y.shape == h.shape


def layer_inputs(b=2, n=3, f=6, k=8):
    torch.manual_seed(1)
    return torch.randn(b, n, f, 16), torch.randn(b, k, 16), torch.randn(b, 16), torch.arange(k)


def test_four_blocks_with_their_own_norm_and_film():
    layer = GroupDanceLayer(16, num_heads=2, ff_dim=32)
    assert len(layer.norms) == len(layer.films) == 4
    layer = GroupDanceLayerWithoutSSM(16, num_heads=2, ff_dim=32)
    assert len(layer.norms) == len(layer.films) == 3


def by_dancer(tokens):
    """All dancers of frame 0, then all of frame 1, ... -> one row a dancer, of three."""
    return rearrange(tokens, "b (f n) d -> b n f d", n=3)


def test_order_is_attention_ssm_cross_attention_feed_forward():
    layer = GroupDanceLayer(16, num_heads=2, ff_dim=32)
    h, memory, cond, frames = layer_inputs()
    tokens = h.transpose(1, 2).flatten(1, 2)
    own = torch.arange(6).repeat_interleave(3)
    x = layer.norms[0](tokens)
    tokens = tokens + layer.films[0](layer.self_attention(x, x, own, own), cond)
    streams = by_dancer(layer.norms[1](tokens))
    mixed = torch.stack([layer.ssm(streams[:, i]) for i in range(3)], dim=2).flatten(1, 2)
    tokens = tokens + layer.films[1](mixed, cond)
    attended = layer.cross_attention(layer.norms[2](tokens), memory, own, frames)
    tokens = tokens + layer.films[2](attended, cond)
    tokens = tokens + layer.films[3](layer.feed_forward(layer.norms[3](tokens)), cond)
    torch.testing.assert_close(layer(h, memory, cond, frames), by_dancer(tokens))


def test_frames_of_tokens_are_shared_by_all_dancers():
    frames = token_frames(torch.zeros(1, 4, 10, 2))
    assert torch.equal(frames.reshape(10, 4), torch.arange(10)[:, None].expand(10, 4))


def test_music_tokens_carry_their_frames():
    """Frame f of the music sits at memory index 1 + f, between swap and step tokens."""
    decoder, seen = make(), []
    decoder.layers[0].register_forward_pre_hook(lambda layer, args: seen.append(args[3]))
    decoder(torch.randn(1, 2, 4, 16), torch.randn(1, 7, 16), torch.randn(1, 16))
    assert seen[0].tolist() == [0, 0, 1, 2, 3, 0, 0]


def test_listens_to_memory_and_condition():
    decoder, h = make(), torch.randn(1, 2, 4, 16)
    memory, cond = torch.randn(1, 7, 16), torch.randn(1, 16)
    y = decoder(h, memory, cond)
    assert not torch.allclose(y, decoder(h, memory.roll(1, 1), cond))
    assert not torch.allclose(y, decoder(h, memory, -cond))


def test_the_memory_counts_in_no_unit():
    decoder, h = make(), torch.randn(1, 2, 4, 16)
    memory, cond = torch.randn(1, 7, 16), torch.randn(1, 16)
    y = decoder(h, memory, cond)
    torch.testing.assert_close(decoder(h, 3 * memory + 2, cond), y, atol=1e-4, rtol=1e-4)
