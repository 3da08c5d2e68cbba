r"""Style: one token that says which genre to dance, and a little which dancer.

Read first: notebook 11 · Lodge section 3.4 · Karras et al. 2019 (StyleGAN) section 2.

Symbols (axes: b batch · g genres · d channels)
    genre   number of the genre                              (b,)
    z       noise: the same genre, danced by another         (b, z)
    style   the token                                        (b, d_model)
"""

from torch import Tensor, nn

from dancediff.nn.mapping_network import MappingNetwork


class StyleToken(nn.Module):
    r"""Turn a genre and noise into the style token.

    $$s = \text{map}_g(z), \qquad z \sim \mathcal N(0, I)$$

    Source: Lodge's code; the paper speaks of an embedding of the genre.  Differs: the released code
    draws z anew in every call of the network, 50 times a dance and without a seed; here the caller
    draws it once.

    Shapes: genre (b,) int, z (b, z) -> (b, d_model).
    Raises: ValueError for a genre out of range, or misshapen noise.

    >>> import torch
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
        # not on a GPU: the check would wait for the numbers, and indexing fails there, too
        known = genre.device.type != "cpu" or set(genre.tolist()) <= set(range(self.num_genres))
        if not known:
            raise ValueError(f"genre={genre.tolist()} must lie in 0 ... {self.num_genres - 1}")
        if z.shape != (len(genre), self.noise):
            raise ValueError(f"z has shape {tuple(z.shape)}; expected {(len(genre), self.noise)}")
        return self.mapping.of_genre(z, genre)
