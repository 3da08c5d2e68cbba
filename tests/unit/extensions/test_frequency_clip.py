import torch

from dancediff.extensions.formation_prior import FormationPrior
from dancediff.extensions.frequency_clip import FrequencyClip, room_for_places
from dancediff.extensions.genre_condition import genres_of
from dancediff.extensions.parts import part_of
from dancediff.extensions.preconditioning import Preconditioning, dct_matrix, preconditioning_of
from dancediff.generation.segmented_dance import largest_guess
from dancediff.generation.tcdiffpp_request import TCDiffPPRequest
from tiny_tcdiffpp import tiny_tcdiffpp


def smooth(w=256, f=60, d=3):
    """Slow random motion: a few low frequencies."""
    g = torch.Generator().manual_seed(0)
    coefficients = torch.zeros(w, f, d)
    coefficients[:, :5] = (
        torch.randn(w, 5, d, generator=g) * torch.tensor([3.0, 2, 1, 0.5, 0.2])[:, None]
    )
    return dct_matrix(f).T @ coefficients + 0.3


def fitted():
    p = Preconditioning(60, 3)
    p.fit([smooth()])
    return p, FrequencyClip(p.mean, p.std)


def test_guesses_are_cut_where_no_dance_is():
    x = smooth()
    p, clip = fitted()
    C = dct_matrix(60).to(x)
    coefficients = C @ (x - p.mean)
    real = (coefficients.abs() < 4 * p.std).all((1, 2))
    assert real.float().mean() > 0.9
    torch.testing.assert_close(clip(x[real].float()), x[real].float(), atol=1e-4, rtol=0)
    coefficients[:, 7, 1] += 100 * p.std[7, 1]  # one frequency of one feature runs away
    back = C @ (clip(p.mean + C.T @ coefficients) - p.mean)
    torch.testing.assert_close(back[:, 7, 1], (4 * p.std[7, 1]).expand(len(x)).to(back))
    coefficients[:, 7, 1] = back[:, 7, 1]
    torch.testing.assert_close(back[real], coefficients[real], atol=1e-4, rtol=0)


def test_a_shorter_guess_is_cut_at_its_own_frequencies():
    p, clip = fitted()
    rest = p.mean.expand(30, 3)
    assert torch.allclose(clip(rest), rest, atol=1e-5)
    assert clip(rest + 1e3).abs().max() < 100


def test_a_wide_formation_is_not_drawn_together():
    """What is cut are ways around a place, not the place: dancers stand 2 m and more apart."""
    g, f = torch.Generator().manual_seed(0), 60
    places = torch.tensor([[-2.2, 0.4], [-1.1, -0.4], [0.0, 0.4], [1.1, -0.4], [2.2, 0.4]])
    steps = 0.2 * torch.randn(64, 5, 1, 2, generator=g)
    paths = (places[None, :, None] + steps).expand(64, 5, f, 2)
    S = torch.arange(5).expand(64, 5)
    prior, p = FormationPrior(5, f), Preconditioning(f, 151)
    prior.fit([(paths, S)])
    x = torch.zeros(64, 5, f, 151)
    x[..., [4, 6]] = paths
    around = x.clone()
    around[..., [4, 6]] -= prior.mean(S)
    p.fit([around.flatten(0, 1)])
    clip = FrequencyClip(p.mean, p.std, room_for_places(prior, 5, 151))
    torch.testing.assert_close(clip(x), x, atol=1e-4, rtol=0)
    assert FrequencyClip(p.mean, p.std)(x)[..., 4].abs().max() < 0.7 * 2.2
    crossing = x.clone()
    way = torch.linspace(-2.2, 2.2, f)
    crossing[:, 0, :, 4], crossing[:, 4, :, 4] = way, -way
    torch.testing.assert_close(clip(crossing), crossing, atol=0.15, rtol=0)
    assert clip(x + 50)[..., 4].max() < 2.2 + 1.5 and clip(x - 50)[..., 4].min() > -2.2 - 1.5


def test_a_request_is_cut_around_the_places_of_its_group():
    model = tiny_tcdiffpp(("preconditioning", "formation_prior")).model
    formation, p = part_of(model, FormationPrior), preconditioning_of(model)
    formation.place[4, :, 0] = torch.linspace(-2.2, 2.2, 5)
    p.std[:] = 0.3
    x = p.mean.expand(1, 5, 150, 151).clone()
    x[..., 4] = torch.linspace(-2.2, 2.2, 5)[:, None]
    five = largest_guess(model, TCDiffPPRequest(dancers=5, frequency_clip=True))
    torch.testing.assert_close(five(x), x, atol=1e-4, rtol=0)
    four = largest_guess(model, TCDiffPPRequest(dancers=4, frequency_clip=True))
    assert four(x)[..., 4].abs().max() < 0.2, "a group whose places nobody knows"


def test_a_genre_is_cut_at_what_it_reaches():
    model = tiny_tcdiffpp(("genre_prior", "preconditioning", "genre_condition")).model
    prior, (calm, wild, *_) = model.parts["genre_prior"], genres_of(model)
    prior.std[0], prior.std[1], prior.mean[1] = 0.01, 0.5, 0.25

    def cut(genre):
        return largest_guess(model, TCDiffPPRequest(genre=genre, frequency_clip=True))

    still = torch.full((1, 3, 150, 151), 0.25)
    assert cut(calm)(still).abs().max() < 0.01
    torch.testing.assert_close(cut(wild)(still), still, atol=1e-4, rtol=0)
    assert cut({calm: 0.5, wild: 0.5})(still).mean() > 0.2, "a mix reaches as far as both"
    everything = preconditioning_of(model)
    assert torch.equal(cut("any").std, everything.std)
    assert torch.equal(cut("any").mean, everything.mean)
