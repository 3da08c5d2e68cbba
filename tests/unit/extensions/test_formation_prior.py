"""The formation prior: the best linear guess of a group that is more than n single dancers."""

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.extensions.formation_prior import FormationPrior
from dancediff.extensions.preconditioning import Preconditioning, dct_matrix
from dancediff.motion.representation import TCDIFFPP
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

FRAMES, DIM = 20, 9
PLACES = list(range(DIM))[TCDIFFPP.floor]
SMALL = {"d_model": 16, "num_layers": 1, "ff_dim": 32, "fusion_hidden": 32, "num_frames": FRAMES}


def walks(n: int, count: int, seed: int = 0):
    """Groups in a row that wander as one, and change places half of the time: paths and S."""
    g = torch.Generator().manual_seed(seed)
    home = torch.arange(n) - (n - 1) / 2
    S = torch.stack([torch.randperm(n, generator=g) for _ in range(count)])
    S[::2] = torch.arange(n)
    w = torch.linspace(0, 1, FRAMES)
    x = home[:, None] + w * (home[S.argsort(1)] - home)[:, :, None]
    together = torch.randn(count, 1, 1, 2, generator=g) * w[:, None]
    own = 0.1 * torch.randn(count, n, 1, 2, generator=g)
    paths = torch.stack([x, torch.zeros_like(x)], -1) + together + own
    return paths, S


@pytest.fixture(scope="module")
def prior():
    prior = FormationPrior(max_dancers=4, num_frames=FRAMES)
    prior.fit([walks(2, 3000), walks(3, 3000)])
    return prior


def test_places_and_ways_are_found(prior):
    assert torch.allclose(prior.place[2, :3, 0], torch.tensor([-1.0, 0.0, 1.0]), atol=0.05)
    assert torch.allclose(prior.place[1, :2, 0], torch.tensor([-0.5, 0.5]), atol=0.05)
    assert torch.allclose(prior.progress, torch.linspace(0, 1, FRAMES), atol=0.05)
    S = torch.tensor([[2, 0, 1]])  # who starts on the right ends on the left
    assert prior.mean(S)[0, :, -1, 0].argsort().tolist() == S[0].tolist()


def test_a_common_step_is_one_movement(prior):
    """Wandering together is the largest mode of the slow frequencies; the others are small."""
    for size in (2, 3):
        mode, std = prior.basis[size - 1, 1, 0, :size, :size], prior.std[size - 1, 1, 0]
        assert torch.allclose(mode[:, -1].abs(), torch.full((size,), size**-0.5), atol=0.02)
        assert std[size - 1] > 10 * std[0]


def test_left_and_right_are_alike():
    paths, S = walks(3, 50)
    n = paths.shape[1]
    mirrored = paths.flip(1) * torch.tensor([-1.0, 1.0])
    S_mirrored = (n - 1 - S).flip(1)
    one, other = (FormationPrior(3, FRAMES) for _ in range(2))
    one.fit([(paths, S)])
    other.fit([(mirrored, S_mirrored)])
    assert torch.allclose(one.place, other.place, atol=1e-5)
    assert torch.allclose(one.progress, other.progress, atol=1e-5)
    assert torch.allclose(one.std, other.std, atol=1e-4)


def test_left_and_right_vary_alike_even_where_the_windows_do_not():
    paths, S = walks(3, 200)
    paths[:, 0] += torch.randn(200, 1, 2, generator=torch.Generator().manual_seed(4))
    one = FormationPrior(3, FRAMES)
    one.fit([(paths, S)])
    U, std = one.basis[2, 0], one.std[2, 0]  # of frequency 0
    cov = U @ torch.diag_embed(std**2) @ U.mT
    torch.testing.assert_close(cov, cov.flip(-1, -2), atol=1e-4, rtol=1e-3)


def test_the_guess_is_the_conditional_mean_of_the_gaussian(prior):
    """Reference: condition all entries of a whole group at once, with one large matrix."""
    n, k = 3, 0  # root x
    S, abar = torch.tensor([[1, 2, 0]]), torch.tensor([0.3])
    C = dct_matrix(FRAMES).double()
    cov = torch.zeros(n * FRAMES, n * FRAMES, dtype=torch.float64)
    for q in range(FRAMES):
        U = prior.basis[n - 1, q, k, :n, :n].double()
        V = U * prior.std[n - 1, q, k, :n].double() ** 2 @ U.T
        cov += torch.kron(V, torch.outer(C[q], C[q]))
    mean = prior.mean(S)[0, :, :, k].flatten().double()
    x_t = torch.randn(1, n, FRAMES, DIM, generator=torch.Generator().manual_seed(1))
    a = abar.double()
    noisy = x_t[0, :, :, PLACES[k]].flatten().double() - a.sqrt() * mean
    seen = a * cov + (1 - a) * torch.eye(n * FRAMES, dtype=torch.float64)
    expected = mean + a.sqrt() * cov @ torch.linalg.solve(seen, noisy)

    guess = Preconditioning(FRAMES, DIM).linear_guess(x_t, abar, prior(S))
    found = guess[0, :, :, PLACES[k]].flatten().double()
    torch.testing.assert_close(found, expected, atol=1e-4, rtol=0)
    others = [c for c in range(DIM) if c not in PLACES]
    alone = Preconditioning(FRAMES, DIM).linear_guess(x_t, abar)
    assert torch.equal(guess[..., others], alone[..., others])


def test_it_misses_less_than_guessing_one_by_one(prior):
    paths, S = walks(3, 500, seed=5)
    x = torch.zeros(500, 3, FRAMES, DIM)
    x[..., TCDIFFPP.floor] = paths
    abar = torch.full((500,), 0.1)
    x_t = abar.sqrt()[0] * x + (1 - abar[0]).sqrt() * torch.randn(
        x.shape, generator=torch.Generator().manual_seed(2)
    )
    alone = Preconditioning(FRAMES, DIM)
    alone.fit([x.flatten(0, 1)])
    missed = [
        (alone.linear_guess(x_t, abar, group) - x)[..., TCDIFFPP.floor].square().mean().item()
        for group in (None, prior(S))
    ]
    assert missed[1] < 0.6 * missed[0], missed


def test_a_short_window_is_the_beginning_of_a_way_that_is_as_long(prior):
    short = prior.mean(torch.tensor([[1, 0]]), f=FRAMES // 2)[0, :, :, 0]
    whole = prior.mean(torch.tensor([[1, 0]]))[0, :, :, 0]
    assert torch.equal(short, whole[:, ::2])


def decoder_guess(prior, S, without):
    torch.manual_seed(0)
    config = TCDiffPPConfig(**SMALL, max_dancers=4, without=without)
    model = build(TCDiffPP, config, ["formation_prior", "preconditioning"])
    model.parts["formation_prior"].load_state_dict(prior.state_dict())
    torch.nn.init.zeros_(model.decoder.out.weight)
    torch.nn.init.zeros_(model.decoder.out.bias)
    x_t = torch.randn(1, 3, FRAMES, 151, generator=torch.Generator().manual_seed(3))
    with torch.no_grad():
        guess = model(x_t, torch.tensor([999]), Conditions(torch.zeros(1, FRAMES, 35), S))[0]
    return guess[0, :, -1, PLACES[0]]


def test_a_model_that_knows_nothing_swaps_as_asked(prior):
    S = torch.tensor([[2, 0, 1]])
    assert decoder_guess(prior, S, ()).argsort().tolist() == [2, 0, 1]
    assert decoder_guess(prior, S, ("swap_mode",)).argsort().tolist() == [0, 1, 2]  # never told


def test_it_is_a_linear_guess_by_rank():
    config = TCDiffPPConfig(**SMALL, without=("dancer_positioning",))
    with pytest.raises(ValueError, match="'formation_prior' is a linear guess by rank"):
        build(TCDiffPP, config, ["formation_prior", "preconditioning"])
    with pytest.raises(ValueError, match="'formation_prior' needs 'preconditioning'"):
        build(TCDiffPP, TCDiffPPConfig(**SMALL), ["formation_prior"])


def test_without_swap_mode_changes_of_place_are_part_of_the_spread(prior):
    paths, S = walks(3, 3000)
    blind = FormationPrior(max_dancers=4, num_frames=FRAMES, use_swap=False)
    blind.fit([(paths, S)])
    assert torch.equal(blind.progress, torch.linspace(0, 1, FRAMES))
    least, told = (one.std[2, 0, 0, :3].min() for one in (blind, prior))
    assert least > 2 * told
