import pytest
import torch

from dancediff.data.choreographer.genres import GENRES as CHOREOGRAPHED
from dancediff.genre import GENRES, TEMPOS, genre_number
from dancediff.nn.mapping_network import MappingNetwork
from dancediff.papers.lodge.style import StyleToken

GENRE = torch.tensor([0, 2, 2])


def test_genres_are_the_choreographers_and_the_recorded():
    assert list(CHOREOGRAPHED) == list(TEMPOS)
    assert GENRES == (*CHOREOGRAPHED, "indian", "captured_salsa")
    assert [genre_number(name, GENRES) for name in GENRES] == list(range(len(GENRES)))
    with pytest.raises(ValueError, match="genre='polka' is unknown; choose one of hiphop"):
        genre_number("polka", GENRES)


def test_head_of_a_genre_is_its_own():
    mapping, x = MappingNetwork(8, 4, num_genres=3), torch.randn(5, 8)
    before = mapping(x)
    torch.nn.init.zeros_(mapping.heads[1][2].weight)
    after = mapping(x)
    assert torch.equal(after[:, [0, 2]], before[:, [0, 2]])
    assert not torch.equal(after[:, 1], before[:, 1])


def test_row_gets_the_genre_it_asks_for():
    token, z = StyleToken(16, num_genres=3, noise=8), torch.randn(3, 8)
    y = token(GENRE, z)
    for row, genre in enumerate(GENRE):
        torch.testing.assert_close(y[row], token.mapping(z[row : row + 1])[0, genre])


def test_noise_makes_another_style_of_the_same_genre():
    token = StyleToken(16, num_genres=3, noise=8)
    y = token(GENRE, torch.randn(3, 8))
    assert (y[1] - y[2]).abs().max() > 1e-3


def test_errors():
    token = StyleToken(16, num_genres=3, noise=8)
    for genre in (torch.tensor([3]), torch.tensor([-1])):
        with pytest.raises(ValueError, match="must lie in 0 "):
            token(genre, torch.randn(1, 8))
    with pytest.raises(ValueError, match=r"z has shape \(3, 7\); expected \(3, 8\)"):
        token(GENRE, torch.randn(3, 7))
