r"""Style: one token that says which genre to dance, and a little which dancer.

Read first: notebook 12 · Lodge section 3.4 · Karras et al. 2019 (StyleGAN) section 2.

Symbols (axes: b batch · g genres · d channels)
    genre   number of the genre                              (b,)
    z       noise: the same genre, danced by another         (b, z)
    style   the token                                        (b, d_model)
"""

import torch
from torch import Tensor, nn

from dancediff.nn.conditioning import BatchInvariantLinear


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

    Source: Lodge's code; the paper speaks of an embedding of the genre.  Differs: the released code
    draws z anew in every call of the network, 50 times a dance and without a seed; here the caller
    draws it once.

    Shapes: genre (b,) int, z (b, z) -> (b, d_model).
    Raises: ValueError for a genre out of range, or misshapen noise.

    >>> token = StyleToken(16, num_genres=3, noise=8)
    >>> token(torch.tensor([0, 2]), torch.randn(2, 8)).shape
    torch.Size([2, 16])
    """

    def __init__(self, d_model: int, num_genres: int, noise: int):
        """A `MappingNetwork`."""
        super().__init__()
        self.num_genres, self.noise = num_genres, noise
        self.mapping = MappingNetwork(noise, d_model, num_genres)

    def forward(self, genre: Tensor, z: Tensor) -> Tensor:
        """One token for each row of the batch."""
        if genre.numel() and not 0 <= int(genre.min()) <= int(genre.max()) < self.num_genres:
            raise ValueError(f"genre={genre.tolist()} must lie in 0 ... {self.num_genres - 1}")
        if z.shape != (len(genre), self.noise):
            raise ValueError(f"z has shape {tuple(z.shape)}; expected {(len(genre), self.noise)}")
        return self.mapping(z)[torch.arange(len(genre), device=genre.device), genre]
