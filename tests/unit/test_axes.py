import pytest
import torch

from dancediff.axes import from_tokens, to_tokens


def test_tokens_are_frame_major():
    x = torch.arange(2 * 3 * 5).reshape(1, 3, 5, 2).float()  # 3 dancers, 5 frames
    tokens = to_tokens(x)
    assert tokens.shape == (1, 15, 2)
    for i in range(3):
        for k in range(5):
            assert torch.equal(tokens[0, k * 3 + i], x[0, i, k])


@pytest.mark.parametrize("n", [1, 2, 5])
def test_round_trip(n):
    x = torch.randn(2, n, 7, 3)
    assert torch.equal(from_tokens(to_tokens(x), n), x)


@pytest.mark.parametrize("n", [0, 2])
def test_token_count_must_fit(n):
    with pytest.raises(ValueError, match=f"15 tokens.*n={n}"):
        from_tokens(torch.zeros(1, 15, 2), n)
