"""What a genre changes is exaggerated, and only where one is asked for."""

from dataclasses import replace

import pytest
import torch

import dancediff as dd
from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.genre_condition import GenreCondition, genres_of
from dancediff.extensions.genre_guidance import genre_guided
from dancediff.generation.guided_denoiser import GuidedDenoiser
from dancediff.generation.presets import PACKAGED
from tiny_tcdiffpp import tiny_tcdiffpp

ASKED = PACKAGED["tcdiffpp"]["genre_guidance"]


@pytest.fixture(scope="module")
def group():
    pipeline = tiny_tcdiffpp(("preconditioning", "genre_condition"))
    part = next(p for p in pipeline.model.modules() if isinstance(p, GenreCondition))
    part.table.data.normal_(generator=torch.Generator().manual_seed(1))
    return pipeline


@pytest.fixture(scope="module")
def song():
    return dd.packaged_song()


def given(group, genre: int) -> tuple[torch.Tensor, Conditions]:
    draw = torch.Generator().manual_seed(0)
    x_t = torch.randn(1, 2, 150, 151, generator=draw)
    shares = torch.eye(len(genres_of(group.model)))[[genre]]
    M = torch.randn(1, 150, 35, generator=draw)
    return x_t, Conditions(M, swap=torch.tensor([[1, 0]]), genre=shares)


def test_the_guess_goes_on_from_that_of_no_genre(group):
    x_t, conditions = given(group, 0)
    with torch.inference_mode():
        plain = GuidedDenoiser(group.model, 1.0, 1, 0).bind(conditions)(x_t, 500)
        none = GuidedDenoiser(group.model, 1.0, 1, 0).bind(
            replace(conditions, genre=torch.zeros_like(conditions.genre))
        )(x_t, 500)
        pushed = GuidedDenoiser(group.model, 1.0, 1, 0, genre_guidance=3.0).bind(conditions)(
            x_t, 500
        )
    assert (plain - none).abs().max() > 1e-4
    torch.testing.assert_close(pushed, none + 3 * (plain - none), atol=1e-5, rtol=1e-4)


def test_a_dance_without_music_has_no_genre_to_exaggerate(group):
    x_t, conditions = given(group, 1)
    with torch.inference_mode():
        plain, pushed = (
            GuidedDenoiser(group.model, 0.0, 1, 0, genre_guidance=w).bind(conditions)(x_t, 500)
            for w in (1, 3.0)
        )
    torch.testing.assert_close(pushed, plain, atol=1e-6, rtol=1e-5)


def test_a_weight_below_one_is_refused():
    with pytest.raises(ValueError, match=r"genre_guidance=0\.5 must be at least 1"):
        genre_guided(lambda conditions: None, Conditions(torch.zeros(1, 4, 35)), 0.5)


@pytest.mark.parametrize(
    ("asked", "weight"),
    [
        ({}, 1),
        ({"genre": "any"}, 1),
        ({"genre": "by tempo"}, 1),
        ({"genre": "jazz"}, ASKED),
        ({"genre": {"jazz": 0.5, "house": 0.5}}, ASKED),
        ({"genre": "jazz", "genre_guidance": 1}, 1),
        ({"genre": "jazz", "preset": "paper"}, 1),
        ({"genre_guidance": 3}, 3),
    ],
)
def test_it_acts_where_a_genre_is_asked_for(group, song, asked, weight):
    assert group.resolve(song, **asked).genre_guidance == weight


def test_without_genres_there_is_nothing_to_exaggerate(song):
    plain = tiny_tcdiffpp(("preconditioning",))
    assert plain.resolve(song).genre_guidance == 1
    with pytest.raises(ValueError, match="genre_guidance=2 needs a model that knows genres"):
        plain.resolve(song, genre_guidance=2)


def test_the_dance_changes(group, song):
    ask = {"dancers": 2, "seconds": 2, "steps": 2, "genre": "jazz"}
    plain, pushed = (group.generate(song, genre_guidance=w, **ask).root for w in (1, 4))
    assert not torch.equal(plain, pushed)
