"""Genre prior: the linear guess is that of the genre which is asked for."""

import pytest
import torch

from dancediff.data.take import DanceTake
from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.extensions.genre_prior import COMMON, GenrePrior
from dancediff.extensions.preconditioning import Preconditioning, preconditioning_of
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.statistics import fit_statistics

F, D = 20, 4
GENRES = ("calm", "wild")
EXTENSIONS = ["genre_prior", "preconditioning", "genre_condition"]


def dances(mean, size, count=20_000):
    """Slow windows around a pose."""
    g = torch.Generator().manual_seed(int(10 * size))
    return mean + size * torch.randn(count, 1, D, generator=g).expand(-1, F, -1)


def fitted():
    calm, wild = dances(-0.5, 0.1), dances(0.5, 0.4)
    all_of_them, prior = Preconditioning(F, D), GenrePrior(2, F, D)
    all_of_them.fit([calm, wild])
    prior.fit([(calm, 0), (wild, 1), (dances(0.0, 3.0), None)], all_of_them.mean, all_of_them.std)
    return prior, all_of_them, calm, wild


def test_each_genre_has_its_own_mean_and_spread():
    prior, *_ = fitted()
    known = prior(torch.eye(2))
    assert torch.allclose(known.mean, torch.tensor([[-0.5], [0.5]]).expand(2, D), atol=0.02)
    spread = known.std[:, 0] / F**0.5  # of the mean over the frames
    assert torch.allclose(spread, torch.tensor([[0.1], [0.4]]).expand(2, D), rtol=0.15)


def test_no_genre_is_all_of_them():
    prior, everything, *_ = fitted()
    known = prior(torch.zeros(1, 2))
    assert torch.equal(known.mean[0], everything.mean)
    assert torch.allclose(known.std[0], everything.std)


def test_half_of_each_is_as_wide_as_both_together():
    prior, everything, *_ = fitted()
    known = prior(torch.full((1, 2), 0.5))
    assert torch.allclose(known.mean[0], everything.mean, atol=0.02)
    assert torch.allclose(known.std[0, 0], everything.std[0], rtol=0.03)


def test_a_genre_that_nobody_danced_is_all_of_them():
    calm = dances(-0.5, 0.1)
    prior, everything = GenrePrior(2, F, D), Preconditioning(F, D)
    everything.fit([calm])
    prior.fit([(calm, 0)], everything.mean, everything.std)
    known = prior(torch.eye(2))
    assert torch.allclose(known.mean[1], everything.mean)
    assert torch.allclose(known.std[1], everything.std, rtol=1e-4)


def test_few_windows_move_a_genre_a_part_of_the_way():
    prior = GenrePrior(1, F, D)
    prior.fit([(torch.ones(COMMON, F, D), 0)], torch.zeros(D), torch.ones(F, D))
    assert torch.allclose(prior(torch.ones(1, 1)).mean, torch.tensor(0.5))


def test_the_guess_misses_less_than_without_the_genre():
    prior, everything, calm, wild = fitted()
    x_0, g = torch.cat([calm[:300], wild[:300]])[:, None], torch.Generator().manual_seed(1)
    w = torch.eye(2).repeat_interleave(300, 0)
    for level in (0.01, 0.1, 0.5):
        abar = torch.full((600,), level)
        x_t = level**0.5 * x_0 + (1 - level) ** 0.5 * torch.randn(x_0.shape, generator=g)
        told = everything.linear_guess(x_t, abar, known=prior(w))
        untold = everything.linear_guess(x_t, abar)
        assert (told - x_0).square().mean() < 0.9 * (untold - x_0).square().mean()


def networks(extensions):
    sizes = {"d_model": 16, "num_layers": 1, "ff_dim": 32}
    group = TCDiffPPConfig(**sizes, fusion_hidden=32)
    yield build(TCDiffPP, group, ["formation_prior", *extensions], GENRES)
    yield build(EDGE, EDGEConfig(**sizes), extensions, GENRES)


@pytest.mark.parametrize("k", [0, 1], ids=["TCDiffPP", "EDGE"])
def test_networks_start_from_it(k):
    model = list(networks(EXTENSIONS))[k].eval()
    model.parts["genre_prior"].mean[1] = 0.3
    x_t, t = torch.randn(3, 2, 20, 151), torch.full((3,), 999)
    w = torch.tensor([[0.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    given = Conditions(torch.randn(3, 20, 35), swap=torch.arange(2).expand(3, 2), genre=w)
    given.music_mask[2] = 0  # dropped: then it has no genre either
    guess = model.linear_guess(x_t, t, given)
    nothing = model.linear_guess(x_t, t, Conditions(given.music, swap=given.swap))
    assert torch.equal(guess[[0, 2]], nothing[[0, 2]])
    assert torch.allclose(guess[1], nothing[1] + 0.3, atol=0.02)
    assert model.denoise(x_t, t, given).shape == x_t.shape


@pytest.mark.parametrize("k", [0, 1], ids=["TCDiffPP", "EDGE"])
def test_what_a_network_adds_is_as_small_as_the_genre_varies(k):
    model = list(networks(EXTENSIONS))[k].eval()
    model.parts["genre_prior"].std[1] = 1e-3
    x_t, t = torch.randn(2, 2, 20, 151), torch.full((2,), 500)
    w = torch.tensor([[1.0, 0.0], [0.0, 1.0]])
    given = Conditions(torch.randn(2, 20, 35), swap=torch.arange(2).expand(2, 2), genre=w)
    with torch.no_grad():
        added = (model.denoise(x_t, t, given) - model.linear_guess(x_t, t, given)).abs()
    added = added[..., 7:]  # places vary as the formation prior says
    assert added[0].mean() > 1e-3
    assert added[1].mean() < 0.005 * added[0].mean()


def test_weights_of_other_genres_are_refused():
    model = next(networks(EXTENSIONS))
    given = Conditions(torch.randn(1, 20, 35), swap=torch.arange(2)[None], genre=torch.ones(1, 3))
    with pytest.raises(ValueError, match=r"genre has shape \(1, 3\); expected \(1, 2\)"):
        model.linear_guess(torch.randn(1, 2, 20, 151), torch.tensor([5]), given)


def test_a_row_does_not_depend_on_the_others():
    prior, *_ = fitted()
    w = torch.rand(7, 2) / 2
    assert torch.equal(prior(w).std[3:4], prior(w[3:4]).std)


def test_training_fits_it_by_the_genres_of_takes():
    model = next(networks(EXTENSIONS))
    g = torch.Generator().manual_seed(0)
    takes = []
    for name, size in (("calm", 0.1), ("wild", 1.0), ("calm", 0.1), (None, 5.0)):
        x = size * torch.randn(2, 1, 151, generator=g) + torch.zeros(2, 200, 151)
        takes.append(DanceTake(f"{name}{size}", x, M=torch.randn(200, 35, generator=g), genre=name))
    fit_statistics(model, takes)
    prior, common = model.parts["genre_prior"], preconditioning_of(model)
    joints = slice(7, None)
    calm, wild, everything = prior.std[:, 0, joints].mean(-1)
    assert calm < wild < everything
    assert torch.equal(prior.std[2], common.std)
