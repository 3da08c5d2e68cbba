r"""Genre condition: which genre, or mix of genres, a group or a soloist is to dance.

Read first: notebook 12, where Lodge's style token does the same for a solo · Ho and Salimans 2022.

Symbols (axes: b batch · g genres · d channels)
    w      shares of a mix, at least 0, together at most 1; zeros: no genre   (b, g)
    E      one learned vector a genre                                        (g, d_model)
    e_0    learned, stands for no genre                                      (d_model,)
    cond   the vector that FiLM gets                                         (b, d_model)
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import send
from dancediff.extensions.parts import Part, Pass, part_of

DROP = 0.15  # share of training windows that are learned without their genre


class GenreCondition(Part):
    r"""Add the mix of genres to the vector of FiLM, from where it reaches every layer.

    $$c \leftarrow c + \sum_g w_g E_g + \Big(1 - \sum_g w_g\Big)\, e_0$$

    Nothing but the music told dances apart before, so that a song which sounded like those of the
    captured duets was danced as one of them. A mix is linear in its shares. Rows whose music is
    masked have no genre, so that classifier-free guidance exaggerates both together. The vectors
    start as long as those of swap modes: from zero they had reached a twentieth of what they are
    added to after 2,400 steps, and the network did not use them.

    Source: ours; the papers' TCDiff++ and EDGE know no genre, Lodge has a style token.

    Shapes: cond (b, d_model), conditions with genre (b, g) or None -> (b, d_model).
    Raises: ValueError for no names, a name that comes twice, or weights of another shape.

    >>> from dancediff.diffusion.conditions import Conditions
    >>> part = GenreCondition(4, ("hiphop", "house"))
    >>> part.table.data[:] = torch.tensor([[1.0], [3.0]])
    >>> mix = Conditions(torch.zeros(2, 9, 35), genre=torch.tensor([[0.5, 0.5], [0.0, 0.0]]))
    >>> part.vectors(mix)[:, 0].tolist()
    [2.0, 0.0]
    """

    def __init__(self, d_model: int, genres: Sequence[str]):
        """Learned: E and e_0."""
        super().__init__()
        self.genres = tuple(genres)
        check_genres(self.genres)
        self.table = nn.Parameter(0.5 * torch.randn(len(self.genres), d_model))
        self.no_genre = nn.Parameter(torch.zeros(d_model))

    def vectors(self, conditions: Conditions) -> Tensor:
        """What is added to each row, (b, d_model)."""
        if conditions.genre is None:
            return self.no_genre.expand(len(conditions), -1)
        w = genre_shares(conditions, len(self.genres))
        # a sum, not a matrix product: then a row does not depend on how many others there are
        mixed = (w[..., None] * self.table).sum(1)
        return mixed + (1 - w.sum(1, keepdim=True)) * self.no_genre

    def film(self, cond: Tensor, run: Pass) -> Tensor:
        """The same for all frames and dancers of a row."""
        return cond + self.vectors(run.conditions)


def genre_shares(conditions: Conditions, genres: int) -> Tensor:
    """The mix of genres that each row is asked for (b, g); zeros for none and for masked music.

    Raises: ValueError for weights of another shape.
    """
    shape, w = (len(conditions), genres), conditions.genre
    if w is None:
        return conditions.music.new_zeros(shape)
    if w.shape != shape:
        raise ValueError(f"genre has shape {tuple(w.shape)}; expected {shape} to match music")
    return w * conditions.music_mask[:, None]


def check_genres(genres: Sequence[str]) -> None:
    """Raises: ValueError unless these are names, at least one, each once."""
    if not genres or len(set(genres)) < len(genres) or not all(type(g) is str for g in genres):
        raise ValueError(f"genres={genres} must hold at least one name, each once")


def genre_condition_of(model: nn.Module) -> GenreCondition | None:
    """That of a model; None where there is none."""
    return part_of(model, GenreCondition)


def genres_of(model) -> tuple[str, ...]:
    """Genres that a model can be asked for, in the order of their numbers; of a plain one none."""
    part = genre_condition_of(model)
    return getattr(model.config, "genres", ()) if part is None else part.genres


def with_dropped_genre(genre: Tensor, generator: torch.Generator) -> Tensor:
    """Training weights (b, g) of which a share of rows, `DROP`, becomes zeros: no genre.

    >>> g = torch.Generator().manual_seed(0)
    >>> kept = with_dropped_genre(torch.ones(10_000, 1), g).mean().item()
    >>> abs(kept - (1 - DROP)) < 0.02
    True
    """
    keep = torch.rand(len(genre), generator=generator) >= DROP
    return genre * send(keep, genre.device)[:, None]
