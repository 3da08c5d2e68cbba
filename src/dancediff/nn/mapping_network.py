r"""A network with a head for each genre: it makes style tokens and verdicts.

Read first: Karras et al. 2019 (StyleGAN) section 2.

Symbols (axes: b batch · g genres · d channels)
    x   noise, or the features of a dance   (b, d_in)
    y   what each genre's head says         (b, g, d_out)
"""

import torch
from torch import Tensor, nn

from dancediff.nn.conditioning import BatchInvariantLinear


class MappingNetwork(nn.Module):
    r"""Two layers that all genres share, then two of each genre's own.

    $$y_g = B_g\,\phi(A_g\,\phi(W_2\,\phi(W_1 x)))$$

    Source: the codes of MNET and Lodge; it makes the style token and the discriminator's logits.
    Differs: ``hidden`` is a size of its own; both codes take d_out, which leaves their
    discriminators a single number between a dance and all verdicts.

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

    def of_genre(self, x: Tensor, genre: Tensor) -> Tensor:
        """What the head of each row's own genre says: x (b, d_in), genre (b,) -> (b, d_out)."""
        return self(x)[torch.arange(len(x), device=x.device), genre]
