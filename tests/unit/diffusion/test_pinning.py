import math

import pytest
import torch

from dancediff.diffusion.pinning import MODES, Pinning
from dancediff.diffusion.samplers import SamplerOptions, sample
from dancediff.diffusion.schedule import cosine_abar

ABAR = cosine_abar()


def gen(seed=0):
    return torch.Generator().manual_seed(seed)


KNOWN = torch.rand(1, 2, 30, 5, generator=gen())
X = torch.randn(1, 2, 80, 5, generator=gen(1))


def test_renoise_matches_the_level_of_the_step():
    known = torch.full((1, 1, 300, 100), 0.5)
    x = torch.zeros(1, 1, 400, 100)
    for t in (979, 500, 19):
        out = Pinning(known, ABAR, mode="renoise", generator=gen(2))(x, t)
        a = float(ABAR[t])
        assert float(out[:, :, :300].mean()) == pytest.approx(0.5 * math.sqrt(a), abs=0.02)
        assert float(out[:, :, :300].std()) == pytest.approx(math.sqrt(1 - a), rel=0.02)
        assert torch.equal(out[:, :, 300:], x[:, :, 300:])


def test_same_noise_is_that_of_the_first_input_at_every_level():
    pin = Pinning(KNOWN, ABAR)
    pin.start(X)
    other = torch.randn(X.shape, generator=gen(5))
    for t in (979, 500, 19):
        a = float(ABAR[t])
        expected = math.sqrt(a) * KNOWN + math.sqrt(1 - a) * X[:, :, :30]
        torch.testing.assert_close(pin(other, t)[:, :, :30], expected)
        assert torch.equal(pin(other, t)[:, :, 30:], other[:, :, 30:])


def test_same_noise_leaves_alone_what_a_deterministic_sampler_makes_of_right_guesses():
    """Were the guesses of the known frames right, DDIM would bring them there by itself."""
    right = torch.cat([KNOWN, torch.zeros(1, 2, 50, 5)], 2)
    paths = []
    for pin in (None, Pinning(KNOWN, ABAR), Pinning(KNOWN, ABAR, mode="renoise", generator=gen())):
        seen = []

        def guess(x_t, t, seen=seen):
            seen.append(x_t)
            return right

        start = pin.start(X) if pin else torch.cat([_noised(KNOWN), X[:, :, 30:]], 2)
        sample(
            guess,
            X.shape,
            SamplerOptions(ABAR, "ddim", 8, eta=0.0),
            x_T=start,
            pin=None if not pin else pin,
        )
        paths.append(torch.stack(seen[1:]))
    torch.testing.assert_close(paths[1], paths[0], atol=1e-4, rtol=0)
    assert (paths[2] - paths[0]).abs().max() > 0.5


def _noised(known):
    a = float(ABAR[-1])
    return math.sqrt(a) * known + math.sqrt(1 - a) * X[:, :, :30]


def test_clean_pastes_the_known_frames_at_every_level():
    pin = Pinning(KNOWN, ABAR, mode="clean")
    for t in (979, 19):
        assert torch.equal(pin(X, t), torch.cat([KNOWN, X[:, :, 30:]], 2))


def test_init_touches_only_the_start():
    pin = Pinning(KNOWN, ABAR, mode="init")
    for t in (979, 19, -1):
        assert torch.equal(pin(X, t), X)
    a = float(ABAR[-1])
    expected = math.sqrt(a) * KNOWN + math.sqrt(1 - a) * X[:, :, :30]
    torch.testing.assert_close(pin.start(X)[:, :, :30], expected)
    assert torch.equal(pin.start(X)[:, :, 30:], X[:, :, 30:])


@pytest.mark.parametrize("mode", MODES)
def test_start_keeps_the_noise_that_is_there(mode):
    # At T - 1 the signal weighs 4.9e-5: eq. 19 as printed hands over next to nothing.
    torch.testing.assert_close(Pinning(KNOWN, ABAR, mode=mode).start(X), X, atol=1e-4, rtol=0)


def test_the_last_guess_is_left_alone():
    for mode in MODES:
        assert torch.equal(Pinning(KNOWN, ABAR, mode=mode)(X, -1), X)


def test_input_is_not_written_to():
    x = X.clone()
    Pinning(KNOWN, ABAR, mode="clean")(x, 19)
    assert torch.equal(x, X)


def test_errors():
    with pytest.raises(ValueError, match="mode='paste'"):
        Pinning(KNOWN, ABAR, mode="paste")
    for x in (X[:, :1], X[:, :, :20], X[..., :3]):
        with pytest.raises(ValueError, match="does not fit"):
            Pinning(KNOWN, ABAR, mode="renoise")(x, 19)
    with pytest.raises(ValueError, match="call start"):
        Pinning(KNOWN, ABAR)(X, 19)
