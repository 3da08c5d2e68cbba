"""The genre condition: mixes, no genre, and a start that changes nothing."""

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.guidance import guided
from dancediff.extensions.build import build
from dancediff.extensions.genre_condition import (
    DROP,
    GenreCondition,
    genres_of,
    with_dropped_genre,
)
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

NAMES = ("hiphop", "house", "jazz")
TINY = {"d_model": 16, "num_layers": 1, "ff_dim": 32}
CONFIGS = {TCDiffPP: TCDiffPPConfig(**TINY, fusion_hidden=32), EDGE: EDGEConfig(**TINY)}
M, S = torch.randn(2, 20, 35), torch.arange(3).expand(2, 3)


def trained(seed: int = 0) -> GenreCondition:
    """A part with random vectors, as after training."""
    part = GenreCondition(16, NAMES)
    g = torch.Generator().manual_seed(seed)
    for p in part.parameters():
        p.data.copy_(torch.randn(p.shape, generator=g))
    return part


def given(genre=None, **other) -> Conditions:
    genre = None if genre is None else torch.tensor(genre).expand(2, -1)
    return Conditions(M, S, genre=genre, **other)


def test_a_mix_is_linear_in_its_shares():
    part = trained()
    one, two, none = (part.vectors(given(w)) for w in ([1.0, 0, 0], [0, 0, 1.0], [0.0, 0, 0]))
    torch.testing.assert_close(part.vectors(given([0.7, 0, 0.3])), 0.7 * one + 0.3 * two)
    torch.testing.assert_close(part.vectors(given([0.4, 0, 0.0])), 0.4 * one + 0.6 * none)


def test_no_genre_is_no_weights_and_masked_music():
    part = trained()
    without = part.vectors(given())
    torch.testing.assert_close(part.vectors(given([0.0, 0, 0])), without)
    mask = torch.tensor([True, False])
    some = part.vectors(given([0, 1.0, 0], music_mask=mask))
    torch.testing.assert_close(some[1], without[1])
    torch.testing.assert_close(some[0], part.table[1])


@pytest.mark.parametrize("kind", CONFIGS)
@pytest.mark.parametrize("names", [[], ["preconditioning", "beat_phase"]], ids=str)
def test_without_a_genre_the_guess_before_training_is_that_without_the_part(kind, names):
    plain = build(kind, CONFIGS[kind], names)
    model = build(kind, CONFIGS[kind], [*names, "genre_condition"], NAMES)
    model.load_state_dict(plain.state_dict(), strict=False)
    x_t, t = torch.randn(2, 3, 20, 151), torch.tensor([10, 900])
    without = plain.denoise(x_t, t, given())
    torch.testing.assert_close(model.denoise(x_t, t, given()), without, atol=1e-6, rtol=1e-6)
    asked = model.denoise(x_t, t, given([0.5, 0.5, 0]))
    assert ((asked - without).abs().amax(-1) > 1e-6).all()


@pytest.mark.parametrize("kind", CONFIGS)
def test_it_reaches_the_guess_of_every_dancer_and_guidance_drops_it(kind):
    model = build(kind, CONFIGS[kind], ["genre_condition"], NAMES).eval()
    (part,) = (p for p in model.modules() if isinstance(p, GenreCondition))
    part.load_state_dict(trained().state_dict())
    assert genres_of(model) == NAMES
    x_t = torch.randn(2, 3, 20, 151)

    def danced(genre, w):
        with torch.no_grad():
            return guided(model.denoise, given(genre), w)(x_t, 500)

    away = (danced([1.0, 0, 0], 1) - danced([0, 1.0, 0], 1)).abs().amax(-1)
    assert (away > 1e-4).all()
    assert torch.equal(danced([1.0, 0, 0], 0), danced([0, 1.0, 0], 0))


def test_another_number_of_weights_and_names_that_come_twice_are_refused():
    with pytest.raises(ValueError, match=r"genre has shape \(2, 2\); expected \(2, 3\)"):
        trained().vectors(given([0.5, 0.5]))
    for names in ((), ("a", "a")):
        with pytest.raises(ValueError, match="at least one name, each once"):
            GenreCondition(16, names)


def test_a_share_of_rows_is_learned_without_its_genre():
    genre = torch.eye(3)[torch.arange(4000) % 3]
    made = [with_dropped_genre(genre, torch.Generator().manual_seed(s)) for s in (3, 3, 4)]
    assert torch.equal(made[0], made[1]) and not torch.equal(made[0], made[2])
    kept = made[0].sum(1)
    assert set(kept.tolist()) == {0.0, 1.0}
    assert abs(1 - kept.mean().item() - DROP) < 4 * (DROP * (1 - DROP) / 4000) ** 0.5
