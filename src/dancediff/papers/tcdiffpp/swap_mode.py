r"""Swap mode S as a condition of the network; how S follows from a dance: `motion.order`.

Read first: notebook 09 · TCDiff++ section 4.2.

Symbols (axes: b batch · n dancers)
    S   S[k] = rank at the first frame of the dancer who stands
        k-th from the left at the last frame; 0..n-1 = nobody swaps  (b, n)
"""

import torch
from torch import Tensor, nn

from dancediff.nn.batch_invariant import BatchInvariantLinear


class SwapModeEmbedding(nn.Module):
    r"""Turn S into one vector.

    $$e(S) = W\,\text{GELU}\Big(\sum_k E_{k,\,S_k}\Big)$$

    The sum is a linear map of the one-hot sequence: one learned vector per (place, dancer).
    It serves as a memory token and joins the FiLM condition.

    Source: TCDiff++ section 4.2 (linear map of the sequence of indices; through FiLM); the extra
    memory token is the released code's.  Differs: the released code maps the indices themselves,
    so that dancer 4 is four times dancer 1, and never passes S in training or inference.

    Shapes: S (b, n) int -> (b, d_model).

    >>> SwapModeEmbedding(5, 16)(torch.tensor([[1, 0, 2]])).shape
    torch.Size([1, 16])
    """

    def __init__(self, max_dancers: int, d_model: int):
        """Learned: the table E (place, dancer, d_model) and one map."""
        super().__init__()
        self.table = nn.Parameter(torch.randn(max_dancers, max_dancers, d_model) * 0.5)
        self.mlp = nn.Sequential(nn.GELU(), BatchInvariantLinear(d_model, d_model))

    def forward(self, S: Tensor) -> Tensor:
        """See the equation."""
        places = torch.arange(S.shape[-1], device=S.device)
        return self.mlp(self.table[places, S].sum(dim=1))
