r"""Contrast: groups that danced together score higher than dancers thrown together.

Read first: Le et al. 2023 (GCD) section 3.4 · Oord et al. 2018 (InfoNCE) eq. 4.

Symbols (axes: b batch of groups · k negatives of each · n dancers · f frames · d motion features)
    x          groups                              (b, n, f, d)
    positive   score of each group                 (b,)
    negative   scores of its negatives             (b, k)
"""

import torch
from torch import Tensor

REPLACED = 0.5  # share of dancers that a negative takes from other groups


def negative_groups(x: Tensor, generator: torch.Generator | None = None) -> Tensor:
    """Groups some of whose dancers come from another group of the batch.

    Each dancer is replaced with probability `REPLACED`, in every group at least one.

    Source: GCD section 3.4.

    Shapes: x (b, n, f, d), b >= 2 -> the same.
    Raises: ValueError for a batch of one group.

    >>> x = torch.arange(3.0)[:, None, None, None].expand(3, 2, 1, 1)
    >>> mixed = negative_groups(x, torch.Generator().manual_seed(0))
    >>> (mixed != x).flatten(1).any(1).tolist()
    [True, True, True]
    """
    b, n = x.shape[:2]
    if b < 2:
        raise ValueError(
            f"x has {b} group; a negative needs dancers of another one, give 2 or more"
        )
    replaced = torch.rand(b, n, generator=generator) < REPLACED
    one = torch.randint(n, (b,), generator=generator)
    replaced[torch.arange(b), one] = True
    shift = torch.randint(1, b, (b, n), generator=generator)
    other = (torch.arange(b)[:, None] + shift) % b
    dancer = torch.randint(n, (b, n), generator=generator)
    return torch.where(replaced.to(x.device)[..., None, None], x[other, dancer], x)


def info_nce(positive: Tensor, negative: Tensor) -> Tensor:
    r"""How hard it is to tell the group from its negatives.

    $$-\log \frac{\exp f^+}{\exp f^+ + \sum_k \exp f^-_k}$$

    Source: GCD section 3.4; Oord et al. eq. 4.

    Shapes: positive (b,), negative (b, k) -> scalar.

    >>> round(info_nce(torch.zeros(2), torch.zeros(2, 3)).exp().item(), 4)      # 1 + k
    4.0
    """
    scores = torch.cat([positive[:, None], negative], dim=1)
    return (scores.logsumexp(dim=1) - positive).mean()
