"""Unison prior: what all dancers do alike is one movement to the linear guess."""

import pytest
import torch

from dancediff.data.take import DanceTake
from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.extensions.preconditioning import Preconditioning, dct_matrix
from dancediff.extensions.unison_prior import MOST, UnisonPrior, common_and_differences
from dancediff.motion.representation import TCDIFFPP
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.statistics import fit_statistics

F, D = 12, 151
FLOOR = torch.arange(D)[TCDIFFPP.floor]
REST = [c for c in range(D) if c not in FLOOR]
EXTENSIONS = ["formation_prior", "unison_prior", "preconditioning"]


def groups(n, rho, count=400, seed=0):
    """Windows in which two dancers of a group correlate by rho; all frequencies alike."""
    g = torch.Generator().manual_seed(seed)
    common = torch.randn(count, 1, F, D, generator=g)
    own = torch.randn(count, n, F, D, generator=g)
    return rho**0.5 * common + (1 - rho) ** 0.5 * own


def fitted(windows, weights=None):
    prior = UnisonPrior(F, D)
    prior.fit(windows, weights)
    return prior


def modes_of(prior, n, f=F):
    run = type("Run", (), {"x_t": torch.zeros(1, n, f, D), "modes": []})()
    prior.prepare(run)
    return run.modes[0]


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_the_basis_is_orthonormal_and_begins_with_all(n):
    U = common_and_differences(n)
    assert torch.allclose(U @ U.T, torch.eye(n), atol=1e-6)
    assert torch.allclose(U[:, 0], torch.full((n,), n**-0.5))


@pytest.mark.parametrize("n", [2, 4])
@pytest.mark.parametrize("rho", [0.0, 0.3, 0.8])
def test_it_finds_how_alike_dancers_are(n, rho):
    found = fitted([groups(n, rho)]).rho
    assert found.mean().item() == pytest.approx(rho, abs=0.03)


def test_solos_say_nothing():
    assert torch.equal(fitted([groups(1, 0.5)]).rho, torch.zeros(F, D))
    both = fitted([groups(1, 0.5), groups(3, 0.5)]).rho
    assert torch.equal(both, fitted([groups(3, 0.5)]).rho)


def test_copies_may_differ_a_little_and_opposites_count_as_strangers():
    copies, opposites = groups(2, 1.0), groups(2, 1.0)
    opposites[:, 1] *= -1
    assert torch.equal(fitted([copies]).rho, torch.full((F, D), MOST))
    assert MOST < 0.999  # a difference of nothing could never be made
    assert torch.equal(fitted([opposites]).rho, torch.zeros(F, D))


def test_windows_count_as_they_are_seen_in_training():
    found = fitted([groups(2, 0.0), groups(2, 0.8, seed=1)], [1.0, 3.0]).rho
    assert found.mean().item() == pytest.approx(0.6, abs=0.03)


def test_the_guess_is_the_conditional_mean_of_the_gaussian():
    """Reference: condition all dancers and frames at once, with one large matrix."""
    n, d, abar = 3, REST[20], torch.tensor([0.3])
    prior, plain = UnisonPrior(F, D), Preconditioning(F, D)
    prior.rho[:] = torch.linspace(0.9, 0.1, F)[:, None]
    plain.mean[:] = 0.2
    plain.std[:] = torch.linspace(1.0, 0.1, F)[:, None]
    C = dct_matrix(F).double()
    cov = torch.zeros(n * F, n * F, dtype=torch.float64)
    for k in range(F):
        alike = prior.rho[k, d] * torch.ones(n, n) + (1 - prior.rho[k, d]) * torch.eye(n)
        cov += torch.kron(plain.std[k, d].double() ** 2 * alike.double(), torch.outer(C[k], C[k]))
    x_t, a = torch.randn(1, n, F, D, generator=torch.Generator().manual_seed(1)), abar.double()
    noisy = x_t[0, ..., d].flatten().double() - a.sqrt() * 0.2
    seen = a * cov + (1 - a) * torch.eye(n * F, dtype=torch.float64)
    expected = 0.2 + a.sqrt() * cov @ torch.linalg.solve(seen, noisy)

    modes = [modes_of(prior, n)]
    guess = plain.linear_guess(x_t, abar, modes)
    torch.testing.assert_close(guess[0, ..., d].flatten().double(), expected, atol=1e-5, rtol=0)
    alone = plain.linear_guess(x_t, abar)
    assert torch.equal(guess[..., FLOOR], alone[..., FLOOR])  # that is the formation prior's


def test_it_misses_less_than_guessing_one_by_one():
    """Reference: Wiener's filter of one movement of variance 1 + 3 rho and three of 1 - rho."""
    x, g = groups(4, 0.7), torch.Generator().manual_seed(2)
    plain, modes = Preconditioning(F, D), [modes_of(fitted([x]), 4)]
    plain.fit([x.flatten(0, 1)])
    for level in (0.05, 0.3, 0.8):
        abar = torch.full((len(x),), level)
        x_t = level**0.5 * x + (1 - level) ** 0.5 * torch.randn(x.shape, generator=g)
        together, alone = (
            (plain.linear_guess(x_t, abar, some) - x)[..., REST].square().mean()
            for some in (modes, [])
        )
        missed = [
            power * (1 - level) / (level * power + 1 - level) for power in (3.1, 0.3, 0.3, 0.3)
        ]
        assert together.item() == pytest.approx(sum(missed) / 4, rel=0.02)
        assert together < 0.95 * alone


def test_a_short_window_knows_fewer_frequencies():
    prior = UnisonPrior(F, D)
    prior.rho[:] = torch.linspace(0, 0.9, F)[:, None]
    assert torch.equal(modes_of(prior, 2, F // 2).rho, prior.rho[::2])


def network(rho):
    torch.manual_seed(0)
    sizes = TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=32)
    model = build(TCDiffPP, sizes, EXTENSIONS).eval()
    model.parts["unison_prior"].rho[:] = rho
    return model


def test_a_network_hears_all_dancers_in_each():
    x_t, t = torch.randn(1, 3, 20, D), torch.tensor([900])
    given = Conditions(torch.randn(1, 20, 35), swap=torch.arange(3)[None])
    other = x_t.clone()
    other[:, 2] += 1.0
    for rho, heard in ((0.0, False), (0.9, True)):
        model = network(rho)
        moved = model.linear_guess(other, t, given) - model.linear_guess(x_t, t, given)
        assert bool(moved[:, 0][..., REST].abs().max() > 0.01) == heard
        assert model.denoise(x_t, t, given).shape == x_t.shape


def test_where_dancers_are_alike_a_network_moves_all_rather_than_one():
    x_t, t = torch.randn(1, 3, 20, D), torch.tensor([900])
    given = Conditions(torch.randn(1, 20, 35), swap=torch.arange(3)[None])
    apart = []
    for rho in (0.0, 0.99):
        model = network(rho)
        with torch.no_grad():
            added = model.denoise(x_t, t, given) - model.linear_guess(x_t, t, given)
        added = added[..., REST]
        apart.append((added - added.mean(1, keepdim=True)).norm().item())
    assert apart[1] < 0.3 * apart[0]


def test_training_fits_it():
    sizes = TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=32)
    model, g = build(TCDiffPP, sizes, EXTENSIONS), torch.Generator().manual_seed(0)
    takes = []
    for k in range(30):
        x = torch.randn(1, 200, 151, generator=g) + 0.5 * torch.randn(2, 200, 151, generator=g)
        x += 2.0  # what is common to all takes says nothing of groups
        takes.append(DanceTake(f"{k}", x, M=torch.randn(200, 35, generator=g)))
    fit_statistics(model, takes)
    rho = model.parts["unison_prior"].rho[:, REST]
    assert rho.mean().item() == pytest.approx(0.8, abs=0.03)
    assert rho[0].mean().item() == pytest.approx(0.8, abs=0.05)
