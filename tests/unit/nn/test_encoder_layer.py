import pytest
import torch

from dancediff.nn.attention import attend
from dancediff.nn.encoder_layer import EncoderLayer, SelfAttention, causal_mask


def layer():
    torch.manual_seed(0)
    return EncoderLayer(16, num_heads=2, ff_dim=32)


def changed(mask, token: int) -> list[bool]:
    """Which outputs move when one token does."""
    made, h = layer(), torch.randn(1, 6, 16, generator=torch.Generator().manual_seed(1))
    other = h.clone()
    other[0, token, :8] += 1
    return ((made(h, mask) - made(other, mask)).abs().amax(-1)[0] > 1e-6).tolist()


def test_a_causal_layer_does_not_see_later_tokens():
    assert changed(causal_mask(6), token=3) == [False] * 3 + [True] * 3
    assert changed(None, token=3) == [True] * 6


def test_numbers_are_added_to_the_logits():
    """As torch does, and as the layer written out for training in half precision does."""
    added = torch.randn(6, 6)
    Q, K, V = torch.randn(3, 1, 2, 6, 8)
    wanted = (Q @ K.mT / 8**0.5 + added).softmax(-1) @ V
    assert torch.allclose(attend(Q, K, V, added), wanted, atol=1e-5)
    half = [x.bfloat16().requires_grad_() for x in (Q, K, V)]
    assert torch.allclose(attend(*half, added.bfloat16()).float(), wanted, atol=0.1)
    hidden = attend(*half, causal_mask(6)).float()
    wanted = (Q @ K.mT / 8**0.5).masked_fill(~causal_mask(6), -torch.inf).softmax(-1) @ V
    assert torch.allclose(hidden, wanted, atol=0.1)


def test_heads_must_divide_the_channels():
    with pytest.raises(ValueError, match="d_model=16 must be a multiple of num_heads=3"):
        SelfAttention(16, 3)
