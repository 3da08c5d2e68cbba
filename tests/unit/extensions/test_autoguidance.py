import pytest
import torch

from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.autoguidance import autoguided, last_pushed
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


def test_guesses_under_little_noise_are_not_pushed():
    push = autoguided(lambda x, t: 3 * x, lambda x, t: x, 1.5, last=5)
    torch.testing.assert_close(push(X, 5), 4 * X)
    torch.testing.assert_close(push(X, 4), 3 * X)


def test_the_last_step_that_is_pushed_has_the_noise_asked_for():
    abar = cosine_abar()
    noise = ((1 - abar) / abar).sqrt()
    for end in (0.05, 0.35, 2.0):
        last = last_pushed(abar, end)
        assert noise[last] >= end > noise[last - 1]
    assert last_pushed(abar, 0.0) == 0
    assert last_pushed(abar, float(noise.max()) + 1) == len(abar)  # none is


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
