import torch

from dancediff.axes import from_tokens
from dancediff.nn.decoder import DecoderLayer, FeedForward, MusicEncoder, frame_of_tokens
from dancediff.nn.ssm import MambaBlock


def make(ssm=True, **options):
    torch.manual_seed(0)
    block = MambaBlock(16, head_dim=8) if ssm else None
    return DecoderLayer(16, num_heads=2, ff_dim=32, ssm=block, **options)


def inputs(b=2, n=3, f=6, k=8):
    torch.manual_seed(1)
    return torch.randn(b, n, f, 16), torch.randn(b, k, 16), torch.randn(b, 16), torch.arange(k)


def test_four_blocks_with_their_own_norm_and_film():
    layer = make()
    assert len(layer.norms) == len(layer.films) == 4
    assert len(make(ssm=False).films) == 3


def test_order_is_attend_remember_listen_think():
    layer, (h, memory, cond, frames) = make(), inputs()
    tokens = h.transpose(1, 2).flatten(1, 2)
    own = torch.arange(6).repeat_interleave(3)
    x = layer.norms[0](tokens)
    tokens = tokens + layer.films[0](layer.self_attention(x, x, own, own), cond)
    streams = from_tokens(layer.norms[1](tokens), 3)
    mixed = torch.stack([layer.ssm(streams[:, i]) for i in range(3)], dim=2).flatten(1, 2)
    tokens = tokens + layer.films[1](mixed, cond)
    heard = layer.cross_attention(layer.norms[2](tokens), memory, own, frames)
    tokens = tokens + layer.films[2](heard, cond)
    tokens = tokens + layer.films[3](layer.feed_forward(layer.norms[3](tokens)), cond)
    torch.testing.assert_close(layer(h, memory, cond, frames), from_tokens(tokens, 3))


def test_dropout_is_off_in_eval_and_on_in_training():
    layer, x = make(dropout=0.5), inputs()
    assert torch.equal(layer.eval()(*x), layer(*x))
    layer.train()
    assert not torch.equal(layer(*x), layer(*x))


def test_frame_of_tokens_is_shared_by_all_dancers():
    assert torch.equal(
        frame_of_tokens(4, 10).reshape(10, 4), torch.arange(10)[:, None].expand(10, 4)
    )


def test_music_encoder_mixes_frames():
    encoder, M = MusicEncoder(35, 16, num_heads=2, ff_dim=32), torch.randn(1, 9, 35)
    M.requires_grad_()
    encoder(M)[:, 0].sum().backward()
    assert (M.grad.abs().amax(-1) > 0).all()


def test_feed_forward_works_on_each_token_alone():
    think, x = FeedForward(8, 16), torch.randn(2, 5, 8)
    torch.testing.assert_close(think(x)[:, 3], think(x[:, 3]))
