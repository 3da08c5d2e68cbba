import pytest
import torch

from dancediff.papers.tcdiffpp.sequence_decoder import SequenceDecoder


def make(**options):
    torch.manual_seed(0)
    return SequenceDecoder(16, num_layers=2, num_heads=2, ff_dim=32, **options)


@pytest.mark.parametrize("ssm", ["ssd", "mamba", "none"])
def test_every_kind_of_layer_runs(ssm):
    h = torch.randn(2, 3, 6, 16)
    assert (
        make(ssm=ssm)(h, torch.randn(2, 9, 16), torch.randn(2, 16), music_start=1).shape == h.shape
    )


def test_music_tokens_carry_their_frames():
    """Frame f of the music sits at memory index 1 + f, between swap and step tokens."""
    decoder, seen = make(), []
    decoder.layers[0].register_forward_pre_hook(lambda layer, args: seen.append(args[3]))
    decoder(torch.randn(1, 2, 4, 16), torch.randn(1, 7, 16), torch.randn(1, 16), music_start=1)
    assert seen[0].tolist() == [0, 0, 1, 2, 3, 0, 0]


def test_listens_to_memory_and_condition():
    decoder, h = make(), torch.randn(1, 2, 4, 16)
    memory, cond = torch.randn(1, 7, 16), torch.randn(1, 16)
    y = decoder(h, memory, cond, music_start=1)
    assert not torch.allclose(y, decoder(h, memory.roll(1, 1), cond, music_start=1))
    assert not torch.allclose(y, decoder(h, memory, -cond, music_start=1))
