"""Residuals around the two components of TCDiff++ that have none in the paper.

The footwork residual lets the Footwork Adaptor correct legs instead of having to copy them first;
the fusion residual adds the mixed dancers to their own tokens.
"""

import torch
from torch import Tensor, nn

from dancediff.nn.decoder import FusionProjection
from dancediff.papers.tcdiffpp.footwork_adaptor import FootworkAdaptor


class FootworkResidual(nn.Module):
    r"""$\hat x = [x_r + x_a]_\text{legs} \oplus [x_r]_\text{rest}$, with $x_a$ near 0 at the start.

    Shapes: as `FootworkAdaptor`.

    >>> x_raw = torch.randn(2, 3, 5, 151)
    >>> residual = FootworkResidual(FootworkAdaptor())
    >>> (residual(x_raw, torch.zeros(2, 3, 5, 2)) - x_raw).abs().max().item() < 0.1
    True
    """

    def __init__(self, adaptor: FootworkAdaptor):
        super().__init__()
        self.adaptor = adaptor
        with torch.no_grad():
            for weights in adaptor.layers[-1].parameters():
                weights.mul_(0.01)

    def forward(self, x_raw: Tensor, v: Tensor) -> Tensor:
        """In float32, as `FootworkAdaptor`."""
        with torch.autocast(x_raw.device.type, enabled=False):
            return self.adaptor.replace_legs(x_raw, x_raw + self.adaptor.adapt(x_raw, v))


class FusionResidual(nn.Module):
    r"""$h \leftarrow h + \text{FP}(h)$, with $\text{FP}(h)$ near 0 at the start.

    So it does not disturb the dancers' own tokens before it has learned anything. That alone does
    not keep its units alive. Share of active units in the second layer after 400 steps (one
    training each):

    =========  ============  ===========
    optimiser  without this  with this
    =========  ============  ===========
    AdamW      0.29          0.07
    Muon       0.33          0.37
    =========  ============  ===========

    Muon at a share of the rate keeps them (docs/differences.md).

    Shapes: as `FusionProjection`.

    >>> residual = FusionResidual(FusionProjection(max_dancers=2, d_model=4, hidden=8))
    >>> h = torch.randn(1, 2, 3, 4)
    >>> (residual(h) - h).abs().max().item() < 0.1
    True
    """

    def __init__(self, fusion_projection: FusionProjection):
        super().__init__()
        self.fusion_projection = fusion_projection
        with torch.no_grad():
            fusion_projection.back.weight.mul_(0.01)

    def forward(self, h: Tensor) -> Tensor:
        """See the equation."""
        return h + self.fusion_projection(h)
