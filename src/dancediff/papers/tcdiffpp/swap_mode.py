r"""Swap mode S: who stands where in the end.

Read first: notebook 09 · TCDiff++ section 4.2.

Symbols (axes: b batch · n dancers · k places from left to right)
    root_x   lateral position of each dancer, metres                      (b, n)
    order    order[k] = the dancer who stands k-th from the left          (b, n)
    S        S[k] = rank at the first frame of the dancer who stands
             k-th from the left at the last frame; 0..n-1 = nobody swaps  (b, n)
"""

import operator

import torch
from torch import Tensor, nn

from dancediff.nn.batch_invariant import BatchInvariantLinear


def left_to_right(root_x: Tensor) -> Tensor:
    """The dancers from left (smallest x) to right; equals keep their order.

    Source: TCDiff++ eq. 5-7.  Differs: the released code sorts along depth, at the last frame, and
    then trains on the unsorted dancers.

    Shapes: (..., n) metres -> (..., n) int.

    >>> left_to_right(torch.tensor([0.5, -1.0, 2.0]))
    tensor([1, 0, 2])
    """
    return root_x.argsort(dim=-1, stable=True)


def swap_mode(x_first: Tensor, x_last: Tensor) -> Tensor:
    """S of a window, from lateral positions at its first and last frame.

    S speaks of ranks at the first frame, so it does not depend on how dancers are numbered.

    Source: TCDiff++ section 4.2.

    Shapes: (..., n), (..., n) metres -> (..., n) int.

    >>> swap_mode(torch.tensor([-1.0, 0.0, 1.0]), torch.tensor([0.1, -1.0, 1.0]))
    tensor([1, 0, 2])
    >>> swap_mode(torch.tensor([1.0, 0.0, -1.0]), torch.tensor([1.0, -1.0, 0.1]))
    tensor([1, 0, 2])
    """
    rank = left_to_right(left_to_right(x_first))  # rank of each dancer: inverse of the order
    return rank.gather(-1, left_to_right(x_last))


def check_order(order, n: int, *, name: str = "swap") -> Tensor:
    """Return ``order`` as an int tensor (n,) if it holds each of 0..n-1 once.

    Raises: ValueError naming the argument, its value and what is allowed.

    >>> check_order([2, 0, 1], 3)
    tensor([2, 0, 1])
    >>> check_order([0, 0], 2)
    Traceback (most recent call last):
    ValueError: swap=[0, 0] must hold each of 0..1 exactly once: swap[k] is the dancer who stands \
k-th from the left in the end
    """
    values = order.tolist() if isinstance(order, Tensor) else list(order)
    try:
        whole = sorted(map(operator.index, values))
    except TypeError:  # 1.0 is no dancer
        whole = None
    if whole != list(range(n)):
        raise ValueError(
            f"{name}={values} must hold each of 0..{n - 1} exactly once: {name}[k] is the dancer "
            "who stands k-th from the left in the end"
        )
    return torch.tensor([operator.index(value) for value in values])


class SwapModeEmbedding(nn.Module):
    r"""Turn S into one vector.

    $$e(S) = W\,\text{GELU}\Big(\sum_k E_{k,\,S_k}\Big)$$

    The sum is a linear map of the one-hot sequence: one learned vector per (place, dancer).
    It serves as a memory token and joins the FiLM condition.

    Source: TCDiff++ section 4.2 (linear map of the sequence of indices; through FiLM); the extra
    memory token is the released code's.  Differs: the released code maps the indices themselves,
    so that dancer 4 is four times dancer 1, and never passes S in training or inference.

    Shapes: S (b, n) int, present (b, n) -> (b, d_model).

    >>> SwapModeEmbedding(5, 16)(torch.tensor([[1, 0, 2]])).shape
    torch.Size([1, 16])
    """

    def __init__(self, max_dancers: int, d_model: int):
        """Learned: the table E (place, dancer, d_model) and one map."""
        super().__init__()
        self.table = nn.Parameter(torch.randn(max_dancers, max_dancers, d_model) * 0.5)
        self.mlp = nn.Sequential(nn.GELU(), BatchInvariantLinear(d_model, d_model))

    def forward(self, S: Tensor, present: Tensor | None = None) -> Tensor:
        """Places of absent dancers do not count."""
        places = torch.arange(S.shape[-1], device=S.device)
        entries = self.table[places, S]
        if present is not None:
            entries = entries * present[..., None]
        return self.mlp(entries.sum(dim=1))
