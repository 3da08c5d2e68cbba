r"""Exponential moving average of a model's weights.

$$\theta_{ema} \leftarrow m\,\theta_{ema} + (1-m)\,\theta,\quad
  m_k = \min\!\Big(m, \tfrac{1+k}{10+k}\Big)$$

The average is young at first (m_k small), so that it does not drag the random start along.
"""

import copy
from typing import Generic, TypeVar

import torch
from torch import Tensor, nn

Network = TypeVar("Network", bound=nn.Module)


class EMA(Generic[Network]):
    """Keeps the averaged copy in ``.model``.

    >>> net = nn.Linear(1, 1)
    >>> ema = EMA(net, decay=0.9)
    >>> ema.update(net)
    >>> torch.equal(ema.model.weight, net.weight)
    True
    """

    def __init__(self, model: Network, decay: float = 0.999):
        self.decay, self.updates = decay, 0
        self.model = copy.deepcopy(model).eval().requires_grad_(False)

    @torch.no_grad()
    def update(self, model: nn.Module) -> None:
        """Move the average a little towards the model."""
        self.updates += 1
        m = min(self.decay, (1 + self.updates) / (10 + self.updates))
        average: list[Tensor] = list(self.model.parameters())
        weights: list[Tensor] = list(model.parameters())
        torch._foreach_lerp_(average, weights, 1 - m)
        for kept, now in zip(self.model.buffers(), model.buffers(), strict=True):
            kept.copy_(now)  # statistics, such as a codebook's, are no weights
