r"""FiLM: let a condition turn the knobs of a layer.

Read first: notebook 08 · Perez et al. 2018 eq. 2.

Symbols (axes: b batch · d channels)
    h     what a layer computed                       (b, ..., d)
    cond  step, music and swap mode in one vector     (b, d)
"""

from torch import Tensor, nn

from dancediff.nn.batch_invariant import BatchInvariantLinear


class FiLM(nn.Module):
    r"""Scale and shift every channel by amounts read off the condition.

    $$\text{FiLM}(h, c) = (1 + \gamma(c)) \odot h + \beta(c), \quad
      [\gamma, \beta] = W\,\text{Mish}(c)$$

    Source: Perez et al. eq. 2; EDGE places it on each sub-layer's output, TCDiff++ follows.

    Shapes: h (b, ..., d), cond (b, d) -> like h.

    >>> import torch
    >>> FiLM(8)(torch.randn(2, 5, 3, 8), torch.randn(2, 8)).shape
    torch.Size([2, 5, 3, 8])
    """

    def __init__(self, d_model: int):
        """One learned map from the condition to 2 d numbers."""
        super().__init__()
        self.knobs = nn.Sequential(nn.Mish(), BatchInvariantLinear(d_model, 2 * d_model))

    def forward(self, h: Tensor, cond: Tensor) -> Tensor:
        """Broadcast over every axis between batch and channels."""
        b, d = cond.shape
        scale, shift = self.knobs(cond).reshape(b, *(1,) * (h.ndim - 2), 2 * d).chunk(2, dim=-1)
        return shift.addcmul(1 + scale, h)
