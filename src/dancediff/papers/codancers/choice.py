r"""How CoDancers learns and takes rare units: focal loss, and shares weighed against training.

Symbols (axes: k codes; any axes in front)
    logits    of the next unit                       (..., k)
    codes     the units that come next               (...)
    p         how likely each unit is                (..., k)
    p_train   how often each was met in training     (..., k)
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from dancediff.nn.losses import mean

ALPHA, GAMMA = 0.6, 2.0
LEAST = 1e-4  # share of a unit that training hardly met


def focal_loss(logits: Tensor, codes: Tensor, *, alpha: float = ALPHA, gamma: float = GAMMA):
    r"""Cross-entropy in which what is known already counts little.

    $$\alpha\,(1 - p)^\gamma\,(-\log p)$$

    Source: CoDancers' code, after Lin et al. 2017 eq. 5.  Shapes: (..., k), (...) -> scalar.

    >>> focal_loss(torch.zeros(3, 2), torch.zeros(3, dtype=torch.long), alpha=1.0, gamma=0.0)
    tensor(0.6931)
    """
    surprise = F.cross_entropy(logits.flatten(0, -2), codes.flatten(), reduction="none")
    return alpha * mean((1 - (-surprise).exp()) ** gamma * surprise)


def reweighted(p: Tensor, p_train: Tensor, theta: float) -> Tensor:
    r"""Shares in which units that training met often count less.

    $$q \propto \frac{\log(1 + \theta p)}{\log(1 + \theta p_{train})}$$

    For small theta it is p / p_train, for large theta hardly any preference is left.

    Source: CoDancers' code, with theta 50.  Shapes: (..., k), (..., k) -> (..., k).

    >>> even = torch.full((4,), 0.25)
    >>> reweighted(torch.tensor([0.4, 0.3, 0.2, 0.1]), even, 50.0).argsort().tolist()
    [3, 2, 1, 0]
    """
    weights = torch.log1p(theta * p) / torch.log1p(theta * p_train.clamp_min(LEAST))
    return weights / weights.sum(-1, keepdim=True)
