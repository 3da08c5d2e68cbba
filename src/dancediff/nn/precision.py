r"""Which numbers a network computes with: all digits, half of them, or whatever is faster here.

Read first: docs/performance.md.

bfloat16 keeps the range of float32 and three of its seven digits. Some processors multiply it
several times as fast (AMX, AVX512-BF16, GPUs since Ampere), others slower than float32, since they
have to convert it first; no list of processors says which as surely as trying.
"""

import time
from functools import lru_cache

import torch
from torch import Tensor
from torch.nn import functional as F

FASTEST = "fastest"
ROWS, WIDTH = 450, 256  # three dancers for 150 frames; between the packaged and the paper's width
TRIES, PATIENCE = 15, 0.2  # and seconds after which a slow processor tries no more
WORTH_IT = 1.2  # times as fast, or the digits are kept


def chosen_dtype(name: str | None, device) -> torch.dtype | None:
    """What the ``dtype`` of a request means on a device: "fastest" is tried out, the rest is taken.

    With "fastest" the same seed gives the same dance as long as the answer is the same; ask for one
    of the two by name where that matters.

    >>> chosen_dtype("bfloat16", "cpu"), chosen_dtype(None, "cpu")
    (torch.bfloat16, None)
    """
    if name is None:
        return None
    return fastest_dtype(torch.device(device).type) if name == FASTEST else getattr(torch, name)


@lru_cache
def fastest_dtype(kind: str) -> torch.dtype:
    """bfloat16 where it is at least `WORTH_IT` times as fast; tried once a process.

    It takes some ms, and up to 3 s where bfloat16 is slow.

    >>> fastest_dtype("cpu") in (torch.float32, torch.bfloat16)
    True
    """
    took = {dtype: _seconds(kind, dtype) for dtype in (torch.float32, torch.bfloat16)}
    faster = took[torch.float32] > WORTH_IT * took[torch.bfloat16]
    return torch.bfloat16 if faster else torch.float32


def _seconds(kind: str, dtype: torch.dtype) -> float:
    """The shortest time of one layer as a network under autocast runs it, conversion included."""
    x = torch.ones(ROWS, WIDTH, device=kind)
    weight = torch.ones(4 * WIDTH, WIDTH, device=kind)

    def layer() -> Tensor:
        return F.linear(F.linear(x, weight), weight.T)

    best, first = float("inf"), time.perf_counter()
    autocast = torch.autocast(kind, torch.bfloat16, enabled=dtype == torch.bfloat16)
    with torch.inference_mode(), autocast:
        for _ in range(TRIES):
            begun = time.perf_counter()
            layer().sum().item()  # asks for a number, so that a GPU is waited for
            best = min(best, time.perf_counter() - begun)
            if begun - first > PATIENCE:
                break
    return best
