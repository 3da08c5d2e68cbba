import math

import pytest
import torch

from dancediff.diffusion.pinning import MODES, Pinning
from dancediff.diffusion.samplers import sample
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
        out = Pinning(known, ABAR, generator=gen(2))(x, t)
        a = float(ABAR[t])
        assert float(out[:, :, :300].mean()) == pytest.approx(0.5 * math.sqrt(a), abs=0.02)
        assert float(out[:, :, :300].std()) == pytest.approx(math.sqrt(1 - a), rel=0.02)
        assert torch.equal(out[:, :, 300:], x[:, :, 300:])


def test_clean_pastes_the_known_frames_at_every_level():
    pin = Pinning(KNOWN, ABAR, mode="clean")
    for t in (979, 19, -1):
        assert torch.equal(pin(X, t), torch.cat([KNOWN, X[:, :, 30:]], 2))


def test_init_touches_only_the_start():
    pin = Pinning(KNOWN, ABAR, mode="init", t_star=400)
    for t in (979, 19, -1):
        assert torch.equal(pin(X, t), X)
    a = float(ABAR[400])
    expected = math.sqrt(a) * KNOWN + math.sqrt(1 - a) * X[:, :, :30]
    torch.testing.assert_close(pin.start(X)[:, :, :30], expected)
    assert torch.equal(pin.start(X)[:, :, 30:], X[:, :, 30:])


@pytest.mark.parametrize("mode", MODES)
def test_start_keeps_the_noise_that_is_there(mode):
    # At T - 1 the signal weighs 4.9e-5: eq. 19 as printed hands over next to nothing.
    torch.testing.assert_close(Pinning(KNOWN, ABAR, mode=mode).start(X), X, atol=1e-4, rtol=0)


@pytest.mark.parametrize("mode", ["renoise", "clean"])
def test_result_holds_the_known_frames(mode):
    pin = Pinning(KNOWN, ABAR, mode=mode, generator=gen(3))
    x = sample(lambda x_t, t: x_t * 0.5, X.shape, abar=ABAR, steps=6, generator=gen(), pin=pin)
    assert torch.equal(x[:, :, :30], KNOWN)


def test_hold_last_off_leaves_the_last_guess():
    for mode in MODES:
        assert torch.equal(Pinning(KNOWN, ABAR, mode=mode, hold_last=False)(X, -1), X)


def test_bend_starts_from_the_known_frames_with_their_speed():
    f = torch.arange(80.0)
    truth = (0.1 + 0.02 * f)[None, None, :, None]
    guess = (0.3 - 0.01 * f)[None, None, :, None]
    pin = Pinning(truth[:, :, :30], ABAR, ease=20)
    bent = pin.bend(guess).flatten()
    torch.testing.assert_close(bent[:30], guess.flatten()[:30])  # known frames: pinned elsewhere
    # frame 30 is where the known motion would have gone; from 50 on the guess is left alone
    torch.testing.assert_close(bent[30], truth.flatten()[30])
    assert float((bent[31] - bent[30] - 0.02).abs()) < 0.005
    torch.testing.assert_close(bent[50:], guess.flatten()[50:])


def test_bend_leaves_a_right_guess_and_the_published_methods_alone():
    torch.testing.assert_close(Pinning(X[:, :, :30], ABAR).bend(X), X)
    for options in ({"ease": 0}, {"mode": "clean"}, {"mode": "init"}):
        assert torch.equal(Pinning(KNOWN, ABAR, **options).bend(X), X)


@pytest.mark.parametrize("k", [1, 2, 80])
def test_bend_with_few_known_frames_or_none_free(k):
    known = torch.ones(1, 1, k, 1)
    bent = Pinning(known, ABAR, ease=5).bend(torch.zeros(1, 1, 80, 1)).flatten()
    assert bent[k:].tolist() == sorted(bent[k:].tolist(), reverse=True)
    if k < 80:
        assert float(bent[k]) == 1.0 and float(bent[k + 5 :].abs().max()) < 1e-6


def test_seam_of_the_exact_denoiser_of_a_smooth_process():
    # Data: a Gaussian process over frames. Its best denoiser is linear and known, so what remains
    # at the seam is the fault of the pinning alone.
    f = torch.arange(60, dtype=torch.float64)
    K = 0.06 * torch.exp(-((f[:, None] - f) ** 2) / (2 * 12**2)) + 1e-6 * torch.eye(60)
    known = torch.linalg.cholesky(K) @ torch.randn(60, 300, generator=gen(), dtype=torch.float64)
    known = known.T[:, None, :30, None]

    def denoise(x_t, t):
        a = float(ABAR[t])
        gain = math.sqrt(a) * K @ torch.linalg.inv(a * K + (1 - a) * torch.eye(60))
        return torch.einsum("fk,bnkd->bnfd", gain, x_t)

    def seam_over_inside(**options):
        pin = Pinning(known, ABAR, generator=gen(1), **options)
        x = sample(
            denoise,
            (300, 1, 60, 1),
            abar=ABAR,
            generator=gen(2),
            pin=pin,
            dtype=torch.float64,
        )
        speed = x.diff(dim=2).square().mean((0, 1, 3)).sqrt()
        return float(speed[29] / speed[40:].mean())

    assert seam_over_inside() < 1.3
    assert seam_over_inside(ease=0) > 2.5


def test_input_is_not_written_to():
    x = X.clone()
    Pinning(KNOWN, ABAR)(x, -1)
    assert torch.equal(x, X)


def test_errors():
    with pytest.raises(ValueError, match="mode='paste'"):
        Pinning(KNOWN, ABAR, mode="paste")
    for t_star in (-1, 1000):
        with pytest.raises(ValueError, match=f"t_star={t_star} "):
            Pinning(KNOWN, ABAR, mode="init", t_star=t_star)
    with pytest.raises(ValueError, match="ease=-1 "):
        Pinning(KNOWN, ABAR, ease=-1)
    for x in (X[:, :1], X[:, :, :20], X[..., :3]):
        with pytest.raises(ValueError, match="does not fit"):
            Pinning(KNOWN, ABAR)(x, 19)
