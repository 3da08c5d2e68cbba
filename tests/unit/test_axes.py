import re
from pathlib import Path

import pytest
import torch

import dancediff
from dancediff.axes import ON_FLOOR, from_tokens, to_tokens
from dancediff.motion.representation import LODGE, TCDIFFPP


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


def test_frame_rate_and_floor_stand_once():
    """A second `FPS = 30`, or the floor's two columns as bare numbers, would drift apart."""
    wrong = re.compile(r"^FPS\b.*=|\[\.\.\., [\[(]0, 2[\])]\]|root\.start \+ 2", re.MULTILINE)
    for path in Path(dancediff.__file__).parent.rglob("*.py"):
        if path.name != "axes.py" and path.parent.name != "exercises":
            assert not wrong.search(path.read_text(encoding="utf-8")), path
    place = torch.arange(3.0)
    for spec in (TCDIFFPP, LODGE):
        x = torch.zeros(spec.dim)
        x[spec.root] = place
        assert torch.equal(x[spec.floor], place[ON_FLOOR])
        assert (x[spec.lateral], x[spec.height]) == (0, 1)
