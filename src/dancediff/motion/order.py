r"""Who stands where, counted from left to right: the order of dancers and the swap mode.

Read first: notebook 09 · TCDiff++ section 4.1. Training windows, long sampling and metrics
all take order and swap mode from here.

Symbols (axes: n dancers · k places from left to right)
    root_x   lateral position of each dancer, metres                      (..., n)
    order    order[k] = the dancer who stands k-th from the left          (..., n)
    S        S[k] = rank at the first frame of the dancer who stands
             k-th from the left at the last frame; 0..n-1 = nobody swaps  (..., n)
"""

import operator

import torch
from torch import Tensor


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

    S counts ranks at the first frame, so it does not depend on how dancers are numbered; dancers
    with equal x at the last frame keep the order of the first.

    Source: TCDiff++ section 4.1.

    Shapes: (..., n), (..., n) metres -> (..., n) int.

    >>> swap_mode(torch.tensor([-1.0, 0.0, 1.0]), torch.tensor([0.1, -1.0, 1.0]))
    tensor([1, 0, 2])
    >>> swap_mode(torch.tensor([1.0, 0.0, -1.0]), torch.tensor([1.0, -1.0, 0.1]))
    tensor([1, 0, 2])
    """
    return left_to_right(x_last.gather(-1, left_to_right(x_first)))


def relative_order(target: Tensor, order: Tensor) -> Tensor:
    """S of dancers who stand in ``order`` now and shall stand in ``target``; (..., n) each.

    >>> relative_order(target=torch.tensor([1, 0, 2]), order=torch.tensor([1, 0, 2]))
    tensor([0, 1, 2])
    """
    return order.argsort(-1).gather(-1, target)


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
    values = order
    try:
        values = order.tolist() if isinstance(order, Tensor) else list(order)
        whole = sorted(map(operator.index, values))
    except TypeError:  # 1.0 is no dancer, 5 no order
        whole = None
    if whole != list(range(n)):
        raise ValueError(
            f"{name}={values} must hold each of 0..{n - 1} exactly once: {name}[k] is the dancer "
            "who stands k-th from the left in the end"
        )
    return torch.tensor([operator.index(value) for value in values])
