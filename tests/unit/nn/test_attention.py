import math

import pytest
import torch

from dancediff.nn.attention import Attention, rope_angles, rope_frequencies, rotate


def softmax_attention(attend, x, memory, x_frames, memory_frames):
    """Vaswani et al. eq. 1, one head after the other."""
    c = attend.channels
    Q = attend.query(x)
    K, V = attend.key_value(memory).chunk(2, dim=-1)
    heads = []
    for h in range(attend.num_heads):
        part = slice(h * c, (h + 1) * c)
        q = rotate(Q[..., part], rope_angles(x_frames, attend.frequencies))
        k = rotate(K[..., part], rope_angles(memory_frames, attend.frequencies))
        logits = q @ k.mT / math.sqrt(c)
        heads.append(logits.softmax(-1) @ V[..., part])
    return attend.out(torch.cat(heads, dim=-1))


@pytest.fixture
def case():
    torch.manual_seed(0)
    x, memory = torch.randn(2, 5, 16), torch.randn(2, 7, 16)
    return Attention(16, num_heads=2), x, memory, torch.arange(5), torch.arange(7)


def test_is_softmax_attention(case):
    attend, *inputs = case
    torch.testing.assert_close(attend(*inputs), softmax_attention(attend, *inputs))


def test_bfloat16_training_path_is_the_same_function(case):
    attend, x, memory, x_frames, frames = case
    plain = attend(x, memory, x_frames, frames)
    with torch.autocast("cpu", torch.bfloat16):
        training = attend(x, memory, x_frames, frames)
        with torch.no_grad():
            inference = attend(x, memory, x_frames, frames)
    assert training.dtype == torch.bfloat16
    torch.testing.assert_close(training.float(), plain, atol=0.03, rtol=0.03)
    torch.testing.assert_close(training, inference, atol=0.03, rtol=0.03)


def test_depends_only_on_frame_differences(case):
    attend, x, memory, x_frames, frames = case
    later = attend(x, memory, x_frames + 40, frames + 40)
    torch.testing.assert_close(later, attend(x, memory, x_frames, frames), atol=1e-4, rtol=1e-4)
    assert not torch.allclose(attend(x, memory, x_frames + 3, frames), later, atol=1e-3)


def test_rotation_is_per_pair_and_keeps_length():
    x = torch.randn(1, 1, 9, 8)
    y = rotate(x, rope_angles(torch.arange(9), rope_frequencies(8)))
    torch.testing.assert_close(y.norm(dim=-1), x.norm(dim=-1))
    one = torch.zeros(1, 1, 1, 8)
    one[..., 1] = 1.0  # pair 1 = channels 1 and 5, frequency 10000^(-2/8) = 0.1
    turned = rotate(one, rope_angles(torch.tensor([5]), rope_frequencies(8)))[0, 0, 0]
    assert turned[1].item() == pytest.approx(math.cos(0.5))
    assert turned[5].item() == pytest.approx(math.sin(0.5))


def test_without_alignment_nothing_peaks():
    attend = Attention(128, num_heads=4)
    x, memory, frames = torch.randn(1, 150, 128), torch.randn(1, 150, 128), torch.arange(150)
    assert attend.weights(x, memory, frames, frames).max() < 0.2


def test_width_must_fit_the_heads():
    with pytest.raises(ValueError, match="d_model=18"):
        Attention(18, num_heads=4)
