r"""Dancer Positioning Embedding (DPE): who stands where, from left to right.

Read first: notebook 07 · TCDiff++ section 4.1, eq. 5-8.

Symbols (axes: b batch · n dancers, ranked from left to right · f frames · d channels)
    h      tokens                                (b, n, f, d)
    rank   0 = the leftmost dancer at frame 0    the index along n
"""

import torch
from torch import Tensor, nn


class DancerPositioning(nn.Module):
    r"""Add one learned vector per left-to-right rank.

    $$h_{n,f} \leftarrow h_{n,f} + e_{\text{rank}(n)}$$

    Dancers arrive sorted by lateral position at the first frame, so the rank is the index.

    Source: TCDiff++ eq. 8 (before the Fusion Projection).  Differs: the paper prints $e \in R^C$,
    one number per dancer; we add a whole vector.  The released code adds sinusoids after the
    fusion, laid out dancer by dancer on tokens that run frame by frame, with identities drawn at
    random in every call: they carry no left-right information.

    Shapes: h (b, n, f, d) -> (b, n, f, d).

    >>> dpe = DancerPositioning(max_dancers=5, d_model=8)
    >>> dpe(torch.zeros(1, 3, 2, 8))[0, :, 0].equal(dpe.table[:3])
    True
    """

    def __init__(self, max_dancers: int, d_model: int):
        """Learned: a table (max_dancers, d_model)."""
        super().__init__()
        self.table = nn.Parameter(0.5 * torch.randn(max_dancers, d_model))

    def forward(self, h: Tensor) -> Tensor:
        """The same vector in all frames of a dancer."""
        return h + self.table[: h.shape[1], None]
