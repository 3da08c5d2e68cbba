"""What the exercises of several lessons need."""

import numpy as np
import torch

NUMBERS = torch.Tensor | np.ndarray


def unlike(got, shape, kinds=torch.Tensor) -> str:
    """What is wrong with an answer that should be finite numbers of a shape, or "".

    >>> unlike(torch.ones(2), (3,))
    'shape (2,), expected (3,)'
    """
    if not isinstance(got, kinds):
        return f"type {type(got).__name__}, expected a tensor {tuple(shape)}"
    if tuple(got.shape) != tuple(shape):
        return f"shape {tuple(got.shape)}, expected {tuple(shape)}"
    return "" if torch.as_tensor(got).isfinite().all() else "some of your numbers are not finite"


def unlike_part(name: str, got, want: torch.Tensor) -> str:
    """What is wrong with one of several things that an answer returns, or "".

    >>> unlike_part("h", torch.ones(2), torch.tensor([1.0, 3.0]))
    'h is wrong at [1]: yours 1, expected 3'
    """
    if wrong := unlike(got, want.shape, NUMBERS):
        return f"{name}: {wrong}"
    mine = torch.as_tensor(got).to(want)
    off = (~torch.isclose(mine, want, rtol=1e-3, atol=1e-4)).nonzero()
    if not len(off):
        return ""
    first = off[0].tolist()
    yours, right = (x[tuple(first)].item() for x in (mine, want))
    return f"{name} is wrong at {first}: yours {yours:.4g}, expected {right:.4g}"


def walks(sizes=((2, 40), (3, 30), (5, 20))) -> list[tuple]:
    """Roots that wander over a stage, one metre up (n, f, 3); no three of them in a row."""
    draw = torch.Generator().manual_seed(0)
    cases = []
    for n, f in sizes:
        root = 0.02 * torch.randn(n, f, 3, generator=draw).cumsum(1)
        angle = torch.arange(n) * 2 * torch.pi / n + torch.pi / 2  # two: one behind the other
        places = torch.stack([1.5 * angle.cos(), torch.ones(n), 1.5 * angle.sin()], -1)
        cases.append((root * torch.tensor([1.0, 0.1, 1.0]) + places[:, None],))
    return cases
