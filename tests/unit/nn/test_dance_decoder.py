import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.nn.decoder import DanceDecoder, DecoderLayer, check_shapes


def make(**options):
    torch.manual_seed(0)
    sizes = {"motion_dim": 139, "music_dim": 35, "music_frames": 24}
    return DanceDecoder(16, 2, 2, 32, **sizes | options).eval()


def test_layer_knows_how_far_apart_tokens_are():
    layer = DecoderLayer(16, num_heads=2, ff_dim=32)
    h, memory, cond = torch.randn(1, 6, 16), torch.randn(1, 4, 16), torch.randn(1, 16)
    near, there = torch.arange(6), torch.arange(4)
    shifted = layer(h, memory, cond, near + 50, there + 50)
    torch.testing.assert_close(layer(h, memory, cond, near, there), shifted, atol=1e-4, rtol=1e-4)
    spread_out = layer(h, memory, cond, 7 * near, there)
    assert (spread_out - shifted).abs().max() > 1e-3


@pytest.mark.parametrize(("pool", "tokens"), [(1, 24), (4, 6), (24, 1)])
def test_pooled_music_has_fewer_tokens_in_the_middle_of_their_frames(pool, tokens):
    decoder = make(pool=pool)
    music, steps, cond = decoder.condition(
        torch.tensor([3, 700]), Conditions(torch.randn(2, 24, 35))
    )
    assert music.shape == (2, tokens, 16) and steps.shape == (2, 2, 16) and cond.shape == (2, 16)
    middles = torch.arange(24.0).reshape(tokens, pool).mean(1)
    assert torch.equal(decoder.music_token_frames, middles)


def test_a_pooled_token_keeps_the_frame_of_a_beat():
    decoder, t = make(pool=4), torch.tensor([500])
    M = torch.zeros(2, 24, 35)
    M[0, 8, 34], M[1, 10, 34] = 1, 1  # two beats that share a token
    music, *_ = decoder.condition(t.expand(2), Conditions(M))
    assert (music[0] - music[1]).abs().max() > 1e-3


def test_without_music_nothing_of_it_is_heard():
    decoder, t = make(), torch.tensor([10, 900])
    none = torch.zeros(2, dtype=torch.bool)
    a, b = (
        decoder.condition(t, Conditions(torch.randn(2, 24, 35), music_mask=none)) for _ in range(2)
    )
    for x, y in zip(a, b, strict=True):
        assert torch.equal(x, y)


def test_music_is_heard_row_by_row():
    decoder, t = make(), torch.tensor([10, 900])
    conditions = Conditions(torch.randn(2, 24, 35))
    music, _, _ = decoder.condition(t, conditions.with_mask(torch.tensor([True, False])))
    assert torch.equal(music[1], decoder.null_music[0])
    torch.testing.assert_close(music[0], decoder.condition(t, conditions)[0][0])


def test_errors():
    with pytest.raises(ValueError, match="pool=5 must divide music_frames=24"):
        make(pool=5)
    with pytest.raises(ValueError, match=r"M has shape None; expected \(2,\)"):
        check_shapes(M=(None, (2,)))
    with pytest.raises(ValueError, match=r"style has shape \(2,\); expected None"):
        check_shapes(style=(torch.zeros(2), None))


def test_only_music_tokens_have_frames_and_the_memory_counts_in_no_unit():
    decoder, seen = make(pool=4), []
    decoder.layers[0].register_forward_pre_hook(lambda layer, args: seen.append(args))
    h, cond, frames = torch.randn(1, 6, 16), torch.randn(1, 16), torch.arange(6)
    music, steps = torch.randn(1, 6, 16), torch.randn(1, 2, 16)
    y = decoder(h, [music, steps], cond, frames)
    _, _, _, own, theirs = seen[0]
    assert own.tolist() == [0, 1, 2, 3, 4, 5]
    assert theirs.tolist() == [1.5, 5.5, 9.5, 13.5, 17.5, 21.5, 0, 0]
    other = decoder(h, [3 * music + 2, 3 * steps + 2], cond, frames)
    torch.testing.assert_close(other, y, atol=1e-4, rtol=1e-4)
