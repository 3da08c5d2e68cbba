"""`dancediff.extensions.preconditioning`."""

import pytest
import torch

from dancediff.diffusion.schedule import cosine_abar, q_sample
from dancediff.extensions.preconditioning import Preconditioning, dct_matrix, linear_coefficients


def smooth(w=256, f=60, d=3):
    """Slow random motion: a few low frequencies."""
    g = torch.Generator().manual_seed(0)
    coefficients = torch.zeros(w, f, d)
    coefficients[:, :5] = (
        torch.randn(w, 5, d, generator=g) * torch.tensor([3.0, 2, 1, 0.5, 0.2])[:, None]
    )
    return dct_matrix(f).T @ coefficients + 0.3


def test_dct_of_a_constant_is_one_coefficient():
    coefficients = dct_matrix(9) @ torch.ones(9)
    assert torch.allclose(coefficients, torch.eye(9)[0] * 3, atol=1e-6)


def test_fit_finds_mean_and_spread():
    x = smooth(w=4000)
    p = Preconditioning(60, 3)
    p.fit([x[:1000], x[1000:]])
    pieces = p.std[:5, 0]
    assert torch.allclose(p.mean, torch.full((3,), 0.3), atol=0.03)
    assert torch.allclose(pieces, torch.tensor([3.0, 2, 1, 0.5, 0.2]), rtol=0.06)
    assert p.std[5:].max() < 1e-3


def test_unfitted_it_is_the_scalar_form_of_edm():
    x_t, F = torch.randn(2, 1, 20, 4), torch.randn(2, 1, 20, 4)
    abar = torch.tensor([0.9, 0.2])
    p = Preconditioning(20, 4)
    skip, scale = (c[:, None, None, None] for c in linear_coefficients(abar, torch.tensor(0.5)))
    guess = p.linear_guess(x_t, abar)
    assert torch.allclose(guess, skip * x_t, atol=1e-5)
    assert torch.allclose(p(F, guess, abar), skip * x_t + scale * F, atol=1e-5)


def test_the_networks_part_of_slow_movements_stays_in_the_units_of_motion():
    p, F = Preconditioning(20, 4), torch.randn(1, 1, 20, 4)
    p.std.fill_(3.0)  # only noise is left: the linear guess misses all of it
    made = p(F, torch.zeros_like(F), torch.zeros(1))
    torch.testing.assert_close(made, 0.5 * F, atol=1e-5, rtol=0)


def test_the_linear_guess_is_as_good_as_it_says():
    """Its error is c_out squared at every noise level, and far below that of one std."""
    x = smooth()
    fitted, plain = Preconditioning(60, 3), Preconditioning(60, 3)
    fitted.fit([x])
    g = torch.Generator().manual_seed(1)
    for t in (50, 300, 700):
        abar = cosine_abar().float()[t].expand(len(x))
        x_t = q_sample(x, t, cosine_abar(), torch.randn(x.shape, generator=g))[:, None]
        mse, worse = (
            (p.linear_guess(x_t, abar)[:, 0] - x).square().mean().item() for p in (fitted, plain)
        )
        _, rest = linear_coefficients(abar[0], fitted.std)
        assert abs(mse / rest.square().mean().item() - 1) < 0.1
        assert mse < worse / 3


def test_a_shorter_window_uses_the_frequencies_it_has():
    x = smooth()
    p = Preconditioning(60, 3)
    p.fit([x])
    short, abar = x[:, None, :30], torch.ones(len(x))
    assert torch.allclose(p.linear_guess(short, abar), short, atol=1e-4)


def test_an_early_guess_trembles_less_than_its_noise():
    """The network's part cannot shake either: its fast frequencies are scaled down."""
    x = smooth()
    p = Preconditioning(60, 3)
    p.fit([x])
    abar = torch.full((len(x),), 0.5)
    added = p(torch.randn(x.shape)[:, None], torch.zeros(len(x), 1, 60, 3), abar)
    assert added.diff(dim=2).std() < added.std() / 3


def test_weights_count_like_repeats():
    a, b = torch.randn(3, 20, 4), 2 * torch.randn(2, 20, 4) + 1
    weighted, repeated = Preconditioning(20, 4), Preconditioning(20, 4)
    weighted.fit([a, b], weights=[1.0, 3.0])
    repeated.fit([a, b, b, b])
    torch.testing.assert_close(weighted.std, repeated.std)
    torch.testing.assert_close(weighted.mean, repeated.mean)


def test_error_is_what_the_linear_guess_misses():
    """Over motion with the std that was fitted, at every noise level."""
    torch.manual_seed(0)
    std = 2.0 / (1 + torch.arange(30.0))[:, None].expand(30, 4)
    precondition = Preconditioning(num_frames=30, dim=4)
    precondition.std.copy_(std)
    x_0 = dct_matrix(30).T @ (std * torch.randn(400, 1, 30, 4))
    abar = cosine_abar().float()
    for t in (10, 300, 900):
        x_t = q_sample(x_0, t, abar, torch.randn(x_0.shape))
        missed = (precondition.linear_guess(x_t, abar[[t]]) - x_0).square().mean()
        assert missed.item() == pytest.approx(precondition.error(abar[[t]]).item(), rel=0.05)


def test_noise_is_what_was_added_where_the_guess_is_right():
    x, abar = smooth(w=2)[:, None], torch.tensor([0.999, 0.3])
    eps = torch.randn(x.shape)
    x_t = abar.sqrt()[:, None, None, None] * x + (1 - abar).sqrt()[:, None, None, None] * eps
    assert torch.allclose(Preconditioning(60, 3).noise(x_t, x, abar), eps, atol=1e-3)


def test_noise_is_of_one_size_at_every_level():
    """Hence a network can hear it at the last steps, too, in numbers of three digits."""
    x = smooth()
    p = Preconditioning(60, 3)
    p.fit([x])
    for t in (2, 50, 500, 990):
        abar = cosine_abar().float()[t].expand(len(x))
        g = torch.Generator().manual_seed(t)
        x_t = q_sample(x, t, cosine_abar(), torch.randn(x.shape, generator=g)).float()[:, None]
        noise = p.noise(x_t, p.linear_guess(x_t, abar), abar)
        assert 0.8 < noise.square().mean().sqrt() < 1.1


def test_autocast_leaves_it_in_float32():
    p, x_t, abar = Preconditioning(60, 3), torch.randn(2, 1, 60, 3), torch.tensor([0.99, 0.5])
    p.fit([smooth()])
    guess = p.linear_guess(x_t, abar)
    full = p(x_t, guess, abar)
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(p.linear_guess(x_t, abar), guess)
        assert torch.equal(p(x_t, guess, abar), full)
