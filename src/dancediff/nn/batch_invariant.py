r"""Rows that come out the same to the last bit, however many are asked for.

Read first: notebook 12 (parallel inference).

Symbols (axes: b batch · i inputs · o outputs)
    x   one vector, or few, for each dance: its step, its music, its genre   (b, ..., i)
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

LANES = 64  # a multiple of what PyTorch's loops take at a time (AVX-512: 2 x 16 numbers)


class BatchInvariantLinear(nn.Linear):
    r"""`torch.nn.Linear` for one vector a dance, or a few.

    $$y_k = W x_k + c, \quad \text{each } k \text{ by itself}$$

    A library multiplies one row by another routine than sixteen, and sums in another order.
    Sampling multiplies such a last digit by a thousand, so a segment would depend on what is danced
    beside it. Layers that see hundreds of frames a dance take one routine anyway.

    Source: ours; no paper asks for it.  Dance by dance on a CPU and without gradients; elsewhere as
    usual.

    Shapes: x (b, ..., i) -> (b, ..., o).

    >>> layer, x = BatchInvariantLinear(64, 32).requires_grad_(False), torch.randn(16, 64)
    >>> torch.equal(layer(x)[:1], layer(x[:1]))
    True
    """

    def forward(self, x: Tensor) -> Tensor:
        """As many products as there are dances."""
        if x.device.type != "cpu" or len(x) == 1 or (torch.is_grad_enabled() and self._learns(x)):
            return super().forward(x)
        return torch.cat([super(BatchInvariantLinear, self).forward(row) for row in x.split(1)])

    def _learns(self, x: Tensor) -> bool:
        return x.requires_grad or self.weight.requires_grad


def batch_invariant_softplus(x: Tensor) -> Tensor:
    r"""Softplus of each number by itself.

    $$y = \ln(1 + e^x)$$

    A library takes many numbers at a time, and those that are left over at the end by another
    routine, which may round otherwise: the last frames of a batch would differ from the same
    frames in its middle. Here nothing is left over.

    Source: ours, as above.

    Shapes: any -> the same.

    >>> x = torch.randn(3, 150, 4)
    >>> torch.equal(batch_invariant_softplus(x)[:1], batch_invariant_softplus(x[:1]))
    True
    >>> torch.allclose(batch_invariant_softplus(x), F.softplus(x))
    True
    """
    flat = x.flatten()
    return F.softplus(F.pad(flat, (0, -len(flat) % LANES)))[: len(flat)].view(x.shape)
