r"""Group embedding and group modulation: one vector tells the whole group how it dances.

Read first: Le et al. 2023 (GCD) section 3.3.

Symbols (axes: b batch · n dancers · f frames · d channels)
    z   latent, drawn once for a dance       (b, d)
    w   group embedding                      (b, d)
    h   tokens of the group                  (b, n, f, d)
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from dancediff.nn.conditioning import BatchInvariantLinear

SLOPE = 0.2  # of LeakyReLU


class GroupEmbedding(nn.Module):
    r"""What a group has in common: latent, music and number of dancers as one vector.

    $$w = \text{MLP}_8(z + \bar M) + e_n, \qquad \bar M = \tfrac1f \sum_f M_f$$

    Source: GCD section 3.3.  Differs: the layers start so that they keep the size of their input
    (He et al. 2015). As in the public code, with torch's default start, all z give nearly the
    same w.

    Shapes: z (b, d), None for zeros, music (b, f, d), n -> (b, d).

    >>> GroupEmbedding(16, max_dancers=5)(torch.randn(2, 16), torch.randn(2, 9, 16), 3).shape
    torch.Size([2, 16])
    """

    def __init__(self, d_model: int, max_dancers: int, num_layers: int = 8):
        """Learned: ``num_layers`` maps, and a vector for every number of dancers."""
        super().__init__()
        layers = [BatchInvariantLinear(d_model, d_model) for _ in range(num_layers)]
        self.maps = nn.ModuleList(layers)
        for layer in layers:
            nn.init.kaiming_normal_(layer.weight, a=SLOPE)
            nn.init.zeros_(layer.bias)
        self.count = nn.Parameter(torch.randn(max_dancers, d_model))

    def forward(self, z: Tensor | None, music: Tensor, n: int) -> Tensor:
        """See the equation."""
        w = music.mean(dim=1) if z is None else z + music.mean(dim=1)
        for layer in self.maps:
            w = F.leaky_relu(layer(w), SLOPE)
        return (w + self.count[n - 1]).float()


class GroupModulation(nn.Module):
    r"""Give all dancers of a group the same mean and spread in every channel, told by w.

    $$h' = (1 + S(w)) \odot \frac{h - \mu}{\sigma} + B(w)$$

    Mean and standard deviation are those of a channel over all dancers and frames of the group.

    Source: GCD section 3.3.  Differs: 1 + S(w) instead of S(w), which in a new network shrinks
    what the blocks before have found to a fiftieth.

    Shapes: h (b, n, f, d), w (b, d) -> like h.

    >>> h = GroupModulation(8)(5 + 3 * torch.randn(2, 3, 50, 8), torch.zeros(2, 8))
    >>> h.shape
    torch.Size([2, 3, 50, 8])
    """

    def __init__(self, d_model: int):
        """One learned map from w to 2 d numbers."""
        super().__init__()
        self.scale_and_shift = BatchInvariantLinear(d_model, 2 * d_model)

    def forward(self, h: Tensor, w: Tensor) -> Tensor:
        """See the equation."""
        scale, shift = self.scale_and_shift(w)[:, None, None].chunk(2, dim=-1)
        variance, mean = torch.var_mean(h, dim=(1, 2), correction=0, keepdim=True)
        return (1 + scale) * (h - mean) * torch.rsqrt(variance + 1e-6) + shift
