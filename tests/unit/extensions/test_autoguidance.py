import pytest
import torch

from dancediff.extensions.autoguidance import autoguided
from dancediff.motion.representation import TCDIFFPP

X = torch.randn(2, 3, 6, 151, generator=torch.Generator().manual_seed(1))


def test_autoguidance_pushes_away_from_the_linear_guess():
    push = autoguided(lambda x, t: 2 * x + 1.0, lambda x, t: x, 1.5)
    torch.testing.assert_close(push(X, 5), X + 1.5 * (X + 1.0))


def test_what_lasts_is_pushed_less():
    """The mean over the frames has a share of the push, the rest all of it; both together agree."""
    push = autoguided(lambda x, t: 3 * x, lambda x, t: x, 1.5, lasting_share=0.25)
    x, mean = push(X, 5), X.mean(-2, keepdim=True)
    torch.testing.assert_close(x.mean(-2, keepdim=True), (3 + 0.5 * 0.25 * 2) * mean)
    torch.testing.assert_close(x - x.mean(-2, keepdim=True), (3 + 0.5 * 2) * (X - mean))


def test_a_weight_of_one_asks_no_linear_guess():
    def never(x, t):
        raise AssertionError("not needed")

    assert autoguided(torch.add, never, 1) is torch.add


def test_a_weight_below_one_would_smooth_and_is_refused():
    for weight in (0.9, float("nan")):
        with pytest.raises(ValueError, match="autoguidance"):
            autoguided(torch.add, torch.add, weight)


def test_the_root_has_its_share():
    x = autoguided(lambda x, t: 3 * x, lambda x, t: x, 1.5, root_share=0.5)(X, 5)
    torch.testing.assert_close(x[..., TCDIFFPP.root], 3.5 * X[..., TCDIFFPP.root])
    torch.testing.assert_close(x[..., TCDIFFPP.rot6d], 4 * X[..., TCDIFFPP.rot6d])
