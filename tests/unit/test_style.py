import pytest
import torch

from dancediff.data.choreographer.genres import GENRES as CHOREOGRAPHED
from dancediff.papers.lodge.style import GENRES, MappingNetwork, StyleToken, genre_number

GENRE = torch.tensor([0, 2, 2])


def test_genres_are_the_choreographers_and_the_captured():
    assert GENRES == (*CHOREOGRAPHED, "indian") and len(GENRES) == 11
    assert [genre_number(name, GENRES) for name in GENRES] == list(range(11))
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


def test_embedding_has_one_token_a_genre():
    token = StyleToken(16, num_genres=3, noise=8, style="embedding")
    y = token(GENRE)
    assert torch.equal(y[1], y[2]) and not torch.equal(y[0], y[1])
    assert torch.equal(token(GENRE, torch.randn(3, 8)), y)
    assert sum(p.numel() for p in token.parameters()) == 3 * 16


def test_errors():
    with pytest.raises(ValueError, match="style='mood'"):
        StyleToken(16, num_genres=3, noise=8, style="mood")
    token = StyleToken(16, num_genres=3, noise=8)
    for genre in (torch.tensor([3]), torch.tensor([-1])):
        with pytest.raises(ValueError, match="must lie in 0 "):
            token(genre, torch.randn(1, 8))
    with pytest.raises(ValueError, match=r"z has shape None; expected \(3, 8\)"):
        token(GENRE)
    with pytest.raises(ValueError, match=r"z has shape \(3, 7\)"):
        token(GENRE, torch.randn(3, 7))
