"""Tables of numbers that are kept on the device that reads them.

A list or a tensor of the CPU that is used in a computation on a GPU is sent there each time, and
the CPU waits until it has arrived: a hundred times a step, if every joint does it.
"""

from collections.abc import Callable
from functools import lru_cache

import torch
from torch import Tensor


def table(make: Callable[..., Tensor], *args, like: Tensor) -> Tensor:
    """``make(*args)`` where ``like`` is and in its precision; made and sent there once.

    All arguments must be hashable, and nobody may write into the result.

    >>> ones = table(torch.tensor, (1.0, 1.0), like=torch.zeros(1, dtype=torch.float64))
    >>> ones.dtype, ones is table(torch.tensor, (1.0, 1.0), like=ones)
    (torch.float64, True)
    """
    return _kept(make, args, like.device, like.dtype)


@lru_cache(maxsize=64)
def _kept(make: Callable[..., Tensor], args: tuple, device, dtype) -> Tensor:
    with torch.inference_mode(False):  # or no training could use it later
        return make(*args).to(device=device, dtype=dtype)
