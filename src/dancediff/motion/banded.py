r"""Systems in which a frame is tied to the two before and the two behind it, and to no other.

A path that is to be smooth and near to something has such a matrix A: weights on its diagonal,
the squares of steps and of bends around it. Symbols (axes: ... any · f frames · c columns)

    bands   bands[o, j] = A[j + o, j], the diagonal and two below it; A is symmetric   (..., 3, f)

The solver is the one of LAPACK for banded matrices, by scipy. It is seven times as fast as a dense
one; and in some builds of PyTorch a batch of dense ones waits for ever after `set_num_threads`.
"""

import torch
from scipy.linalg import solveh_banded
from torch import Tensor


def nearness(weight: Tensor) -> Tensor:
    r"""Bands of $\sum_i w_i u_i^2$: (..., f) -> (..., 3, f).

    >>> nearness(torch.tensor([1.0, 2.0])).tolist()
    [[1.0, 2.0], [0.0, 0.0], [0.0, 0.0]]
    """
    return torch.stack([weight, torch.zeros_like(weight), torch.zeros_like(weight)], -2)


def steps(weight: Tensor) -> Tensor:
    r"""Bands of $\sum_i w_i (u_{i+1} - u_i)^2$: (..., f - 1) -> (..., 3, f).

    >>> steps(torch.tensor([1.0, 2.0])).tolist()
    [[1.0, 3.0, 2.0], [-1.0, -2.0, -0.0], [0.0, 0.0, 0.0]]
    """
    none = weight.new_zeros(*weight.shape[:-1], 1)
    here, before = torch.cat([weight, none], -1), torch.cat([none, weight], -1)
    return torch.stack([here + before, -here, torch.zeros_like(here)], -2)


def bends(f: int) -> Tensor:
    r"""Bands of $\sum_i (u_{i+2} - 2 u_{i+1} + u_i)^2$, (3, f) double.

    >>> bends(4).tolist()
    [[1.0, 5.0, 5.0, 1.0], [-2.0, -4.0, -2.0, 0.0], [1.0, 1.0, 0.0, 0.0]]
    """
    out = torch.zeros(3, f, dtype=torch.float64)
    last = max(f - 2, 0)
    for shift, (square, with_next, with_second) in enumerate([(1, -2, 1), (4, -2, 0), (1, 0, 0)]):
        out[:, shift : shift + last] += out.new_tensor([[square], [with_next], [with_second]])
    return out


def weighted_bends(weight: Tensor) -> Tensor:
    r"""Bands of $\sum_i w_i (u_{i+2} - 2 u_{i+1} + u_i)^2$: (..., f - 2) -> (..., 3, f).

    >>> torch.equal(weighted_bends(torch.ones(2).double()), bends(4))
    True
    """
    none = weight.new_zeros(*weight.shape[:-1], 1)
    first, middle, last = (
        torch.cat([none] * k + [weight] + [none] * (2 - k), -1) for k in range(3)
    )
    return torch.stack([first + 4 * middle + last, -2 * (first + middle), first], -2)


def dense(bands: Tensor) -> Tensor:
    """The whole symmetric matrix: (..., 3, f) -> (..., f, f).

    >>> dense(torch.tensor([[1.0, 2.0], [5.0, 0.0], [0.0, 0.0]])).tolist()
    [[1.0, 5.0], [5.0, 2.0]]
    """
    A = torch.diag_embed(bands[..., 0, :])
    for o in range(1, min(3, bands.shape[-1])):
        below = torch.diag_embed(bands[..., o, :-o], -o)
        A = A + below + below.mT
    return A


def solve_banded_ref(bands: Tensor, b: Tensor) -> Tensor:
    """Solve A x = b with the whole matrix. Read this one.

    Shapes: as `solve_banded`.

    >>> solve_banded_ref(nearness(torch.tensor([2.0, 4.0])), torch.tensor([[2.0], [2.0]])).tolist()
    [[1.0], [0.5]]
    """
    return torch.linalg.solve(dense(bands), b)


def solve_banded(bands: Tensor, b: Tensor) -> Tensor:
    """Solve A x = b for every matrix of a batch, on the CPU; no gradients.

    `solve_banded_ref`, faster: the solver of LAPACK looks at the three bands only. A system with
    numbers that are not finite has NaN as its solution.

    Shapes: bands (..., 3, f), b (..., f, c) -> (..., f, c), where ``b`` was.
    Raises: numpy.linalg.LinAlgError when a matrix is not positive definite.

    >>> bands, b = nearness(torch.ones(9)) + bends(9), torch.randn(9, 2).double()
    >>> torch.allclose(solve_banded(bands, b), solve_banded_ref(bands, b))
    True
    """
    matrices = bands.detach().double().cpu().reshape(-1, *bands.shape[-2:])
    right = b.detach().double().cpu().reshape(-1, *b.shape[-2:])
    out = torch.full_like(right, torch.nan)
    finite = matrices.isfinite().all(-1).all(-1)
    for k in finite.nonzero().flatten().tolist():
        solved = solveh_banded(
            matrices[k].numpy(), right[k].numpy(), lower=True, check_finite=False
        )
        out[k] = torch.from_numpy(solved)
    return out.view(b.shape).to(b)
