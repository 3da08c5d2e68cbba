import torch

from dancediff.nn.attention import FeedForward
from dancediff.nn.conditioning import CACHED, MusicEncoder, cached_music
from dancediff.nn.decoder import DecoderLayer


def inputs(b=2, m=6, k=8):
    torch.manual_seed(1)
    h, memory, cond = torch.randn(b, m, 16), torch.randn(b, k, 16), torch.randn(b, 16)
    return h, memory, cond, torch.arange(m), torch.arange(k)


def test_order_is_attention_cross_attention_feed_forward():
    layer, (h, memory, cond, frames, theirs) = DecoderLayer(16, num_heads=2, ff_dim=32), inputs()
    x = layer.norms[0](h)
    y = h + layer.films[0](layer.self_attention(x, x, frames, frames), cond)
    attended = layer.cross_attention(layer.norms[1](y), memory, frames, theirs)
    y = y + layer.films[1](attended, cond)
    y = y + layer.films[2](layer.feed_forward(layer.norms[2](y)), cond)
    torch.testing.assert_close(layer(h, memory, cond, frames, theirs), y)


def test_dropout_is_off_in_eval_and_on_in_training():
    layer, x = DecoderLayer(16, num_heads=2, ff_dim=32, dropout=0.5), inputs()
    assert torch.equal(layer.eval()(*x), layer(*x))
    layer.train()
    assert not torch.equal(layer(*x), layer(*x))


def test_music_encoder_mixes_frames():
    encoder, M = MusicEncoder(35, 16, num_heads=2, ff_dim=32), torch.randn(1, 9, 35)
    M.requires_grad_()
    encoder(M)[:, 0].sum().backward()
    assert (M.grad.abs().amax(-1) > 0).all()


def test_feed_forward_works_on_each_token_alone():
    think, x = FeedForward(8, 16), torch.randn(2, 5, 8)
    torch.testing.assert_close(think(x)[:, 3], think(x[:, 3]))


def test_a_token_of_several_frames_is_a_map_of_neighbours_side_by_side():
    encoder = MusicEncoder(35, 16, num_heads=2, ff_dim=32, pool=3, num_layers=0)
    M = torch.randn(2, 9, 35)
    torch.testing.assert_close(encoder(M)[:, 1], encoder.linear(M[:, 3:6].flatten(1)))


def test_cached_music_is_that_of_the_song_at_hand():
    encoder = MusicEncoder(35, 16, num_heads=2, ff_dim=32)
    first, second = torch.randn(2, 1, 9, 35)
    with cached_music(encoder):
        encoder(first)
        torch.testing.assert_close(encoder(second), encoder._encode(second))


def test_all_parts_of_a_long_dance_are_encoded_once(monkeypatch):
    encode, count = MusicEncoder._encode, []
    counted = lambda self, M: (count.append(0), encode(self, M))[1]  # noqa: E731
    monkeypatch.setattr(MusicEncoder, "_encode", counted)
    encoder, parts = MusicEncoder(35, 16, num_heads=2, ff_dim=32), torch.randn(9, 1, 9, 35)
    with cached_music(encoder):
        first = [encoder(part) for part in parts]
        again = [encoder(part) for part in parts]
        assert len(count) == 9 and all(a is b for a, b in zip(first, again, strict=True))
        for _ in range(100):
            encoder(torch.randn(1, 9, 35))
        assert len(encoder._cached) == CACHED
