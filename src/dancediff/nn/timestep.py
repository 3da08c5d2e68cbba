r"""Telling the network how noisy its input is.

Read first: notebook 05 · Ho et al. 2020 appendix B · Vaswani et al. 2017 section 3.5.

Symbols (axes: b batch)
    t   the diffusion step, 0 (clean) .. T-1 (noise)   (b,)
"""

import math

import torch
from torch import Tensor, nn

from dancediff.nn.batch_invariant import BatchInvariantLinear


def sinusoid(t: Tensor, channels: int) -> Tensor:
    r"""Sines and cosines of t at geometrically spaced frequencies from 1 to 1/10000.

    Source: DDPM appendix B; halves (all sines, then all cosines) as in EDGE.

    Shapes: t (b,) -> (b, channels).

    >>> sinusoid(torch.tensor([0]), 4)
    tensor([[0., 0., 1., 1.]])
    """
    half = channels // 2
    frequency = torch.exp(-math.log(10_000) * torch.arange(half, device=t.device) / (half - 1))
    angle = t[:, None].float() * frequency
    return torch.cat([angle.sin(), angle.cos()], dim=-1)


class TimestepEncoder(nn.Module):
    """Turn a step t into one vector for FiLM and two tokens for the memory.

    Source: EDGE; TCDiff++ keeps it.

    Shapes: t (b,) -> (b, d_model), (b, 2, d_model).

    >>> vector, tokens = TimestepEncoder(16)(torch.tensor([0, 500, 999]))
    >>> vector.shape, tokens.shape
    (torch.Size([3, 16]), torch.Size([3, 2, 16]))
    """

    def __init__(self, d_model: int):
        """A hidden layer four times as wide, then two heads."""
        super().__init__()
        self.hidden = nn.Sequential(BatchInvariantLinear(d_model, 4 * d_model), nn.Mish())
        self.to_vector = BatchInvariantLinear(4 * d_model, d_model)
        self.to_tokens = BatchInvariantLinear(4 * d_model, 2 * d_model)

    def forward(self, t: Tensor) -> tuple[Tensor, Tensor]:
        """Both forms of the step."""
        hidden = self.hidden(sinusoid(t, self.hidden[0].in_features))
        return self.to_vector(hidden), self.to_tokens(hidden).unflatten(-1, (2, -1))
