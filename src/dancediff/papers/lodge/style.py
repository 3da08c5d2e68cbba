r"""Style: one token that says which genre to dance, and a little which dancer.

Read first: notebook 12 · Lodge section 3.4 · Karras et al. 2019 (StyleGAN) section 2.

Symbols (axes: b batch · g genres · d channels)
    genre   number of the genre                              (b,)
    z       noise: the same genre, danced by another         (b, z)
    style   the token                                        (b, d_model)
"""

import math

import torch
from torch import Tensor, nn

from dancediff.data.choreographer.genres import GENRES as CHOREOGRAPHED
from dancediff.nn.batch_invariant import BatchInvariantLinear

GENRES = (*CHOREOGRAPHED, "indian")  # those of the choreographer, and of the captured solos
STYLES = ("mapping", "embedding")


def genres() -> list[str]:
    """Names of the genres that a Lodge model with default sizes knows.

    >>> genres()[:3]
    ['hiphop', 'popping', 'locking']
    """
    return list(GENRES)


def genre_for(tempo: float, genres: tuple[str, ...]) -> str:
    """The genre whose usual tempos have their middle nearest, as a ratio, to the song's.

    Genres whose tempo nobody wrote down are not chosen, unless there is no other; without a beat
    (``tempo`` nan) it is the first.

    >>> genre_for(125.0, GENRES), genre_for(80.0, GENRES), genre_for(float("nan"), GENRES)
    ('house', 'contemporary', 'hiphop')
    """
    known = [name for name in genres if name in CHOREOGRAPHED]
    if not known or math.isnan(tempo):
        return (known or genres)[0]

    def far(name: str) -> float:
        return abs(math.log(tempo / (sum(CHOREOGRAPHED[name].tempo) / 2)))

    return min(known, key=far)


def genre_number(name: str, genres: tuple[str, ...]) -> int:
    """Number of a genre.

    Raises: ValueError naming the genre and those there are.

    >>> genre_number("salsa", ("hiphop", "salsa"))
    1
    """
    if name not in genres:
        raise ValueError(f"genre={name!r} is unknown; choose one of {', '.join(genres)}")
    return genres.index(name)


class MappingNetwork(nn.Module):
    r"""Two layers that all genres share, then two of each genre's own.

    $$y_g = B_g\,\phi(A_g\,\phi(W_2\,\phi(W_1 x)))$$

    Source: Lodge's code, after MNET; it makes the style token and the discriminator's logits.
    Differs: ``hidden`` is a size of its own; the released code takes d_out, which leaves its
    discriminator a single number between a dance and all 16 verdicts.

    Shapes: x (b, d_in) -> all genres' outputs (b, g, d_out).

    >>> MappingNetwork(8, 4, num_genres=3)(torch.randn(2, 8)).shape
    torch.Size([2, 3, 4])
    """

    def __init__(self, d_in: int, d_out: int, num_genres: int, hidden: int | None = None):
        """Learned: 2 + 2 g linear maps."""
        super().__init__()
        hidden = d_out if hidden is None else hidden
        self.shared = nn.Sequential(
            BatchInvariantLinear(d_in, hidden),
            nn.GELU(),
            BatchInvariantLinear(hidden, hidden),
            nn.GELU(),
        )
        self.heads = nn.ModuleList(
            nn.Sequential(
                BatchInvariantLinear(hidden, hidden), nn.GELU(), BatchInvariantLinear(hidden, d_out)
            )
            for _ in range(num_genres)
        )

    def forward(self, x: Tensor) -> Tensor:
        """Run every head; there are few and they are small."""
        shared = self.shared(x)
        return torch.stack([head(shared) for head in self.heads], dim=1)


class StyleToken(nn.Module):
    r"""Turn a genre and noise into the style token.

    $$s = \text{map}_g(z), \qquad z \sim \mathcal N(0, I)$$

    Source: Lodge's code (mapping network); ``style="embedding"`` is the paper's plain embedding of
    the genre, where z has no say.  Differs: the released code draws z anew in every call of the
    network, 50 times a dance and without a seed; here the caller draws it once.

    Shapes: genre (b,) int, z (b, z) -> (b, d_model).
    Raises: ValueError for another style, a genre out of range, or missing or misshapen noise.

    >>> token = StyleToken(16, num_genres=3, noise=8)
    >>> token(torch.tensor([0, 2]), torch.randn(2, 8)).shape
    torch.Size([2, 16])
    """

    def __init__(self, d_model: int, num_genres: int, noise: int, style: str = "mapping"):
        """A `MappingNetwork` or one vector for each genre."""
        super().__init__()
        if style not in STYLES:
            raise ValueError(f"style={style!r} is not one of {', '.join(map(repr, STYLES))}")
        self.num_genres, self.noise = num_genres, noise
        self.mapping = MappingNetwork(noise, d_model, num_genres) if style == "mapping" else None
        self.table = nn.Embedding(num_genres, d_model) if style == "embedding" else None

    def forward(self, genre: Tensor, z: Tensor | None = None) -> Tensor:
        """One token for each row of the batch."""
        if genre.numel() and not 0 <= int(genre.min()) <= int(genre.max()) < self.num_genres:
            raise ValueError(f"genre={genre.tolist()} must lie in 0 ... {self.num_genres - 1}")
        if self.mapping is None:
            return self.table(genre)
        if z is None or z.shape != (len(genre), self.noise):
            shape = None if z is None else tuple(z.shape)
            raise ValueError(f"z has shape {shape}; expected {(len(genre), self.noise)}")
        rows = torch.arange(len(genre), device=genre.device)
        return self.mapping(z)[rows, genre]
