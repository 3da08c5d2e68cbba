r"""Fusion Projection (FP): look at the whole group at once, frame by frame.

Read first: notebook 07 · TCDiff++ section 4.1, eq. 8.

Symbols (axes: b batch · n dancers, ranked from left to right · f frames · d channels)
    h   tokens   (b, n, f, d)
"""

import torch.nn.functional as F
from einops import rearrange
from torch import Tensor, nn


class FusionProjection(nn.Module):
    r"""A three-layer network over all dancers of one frame, side by side.

    $$[h_1, \dots, h_C] \leftarrow W_3\,\text{ReLU}(W_2\,\text{ReLU}(W_1\,[h_1, \dots, h_C]))$$

    Every place in the row has its own weights: this is where left and right become different, and
    also where a group of five and a group of three become one problem. Absent dancers are zeros.

    Source: TCDiff++ eq. 8; no residual and no norm, as in the released code. With ``residual``
    (ours) the mixed dancers are added to their own tokens, which learns faster.  Differs: the
    papers train one model per group size; ours is as wide as ``max_dancers`` and is theirs exactly
    when ``max_dancers`` equals the group size.

    Shapes: h (b, n, f, d), n <= max_dancers -> (b, n, f, d).

    >>> import torch
    >>> fp = FusionProjection(max_dancers=5, d_model=8, hidden=16)
    >>> h = torch.randn(1, 3, 2, 8)
    >>> padded = torch.cat([h, torch.zeros(1, 2, 2, 8)], dim=1)
    >>> torch.allclose(fp(h), fp(padded)[:, :3], atol=1e-6)
    True
    """

    def __init__(self, max_dancers: int, d_model: int, hidden: int, *, residual: bool = False):
        """Learned: three maps, started so that the signal keeps its size (He et al. 2015).

        Nothing leads around this block, so what torch's default start would shrink here is lost.
        """
        super().__init__()
        self.residual = residual
        self.into = nn.Linear(max_dancers * d_model, hidden)
        self.middle = nn.Linear(hidden, hidden)
        self.back = nn.Linear(hidden, max_dancers * d_model)
        for layer in (self.into, self.middle, self.back):
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            nn.init.zeros_(layer.bias)

    def forward(self, h: Tensor) -> Tensor:
        """Mix across dancers, never across frames."""
        n, d = h.shape[1], h.shape[3]
        if n * d > self.into.in_features:
            raise ValueError(f"h has {n} dancers; at most {self.into.in_features // d} fit")
        row = rearrange(h, "b n f d -> b f (n d)")
        # Zeros for absent dancers times weights are zeros: use only the columns that meet somebody.
        x = F.relu(F.linear(row, self.into.weight[:, : n * d], self.into.bias))
        x = F.relu(self.middle(x))
        row = F.linear(x, self.back.weight[: n * d], self.back.bias[: n * d])
        mixed = rearrange(row, "b f (n d) -> b n f d", n=n)
        return h + mixed if self.residual else mixed
