r"""Unison prior: to the linear guess, what all dancers of a group do alike is one movement.

Read first: notebook 06 · `dancediff.extensions.group_modes`.

Symbols (axes: b batch · n dancers · r modes, as many · f frames · k frequencies · d features)
    c_n    of each dancer, less the mean                        (b, n, k, d)
    rho    correlation of two dancers of a group                (k, d)
    U      orthonormal; its first column is the same for all    (n, r)
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import repeat

import torch
from torch import Tensor

from dancediff.extensions.group_modes import GroupModes
from dancediff.extensions.parts import Part, Pass
from dancediff.extensions.preconditioning import SMALLEST, dct_matrix
from dancediff.lookup import table
from dancediff.motion.representation import TCDIFFPP

MOST = 0.99  # of rho: a dancer may always differ a little from the others


def common_and_differences(n: int) -> Tensor:
    """U: what all do, then how each differs from the mean of those before it; (n, n).

    >>> common_and_differences(2).mul(2**0.5).round().tolist()
    [[1.0, 1.0], [1.0, -1.0]]
    """
    U = torch.zeros(n, n, dtype=torch.float64)
    U[:, 0] = 1
    for r in range(1, n):
        U[:r, r], U[r, r] = 1, -r
    return (U / U.norm(dim=0)).float()


@dataclass(frozen=True)
class UnisonModes(GroupModes):
    """What all dancers do and how they differ: `GroupModes` of all but places on the floor.

    Shapes: rho (k, d).
    """

    THERE, BACK = "nr,bnkd->brkd", "nr,brkd->bnkd"

    rho: Tensor

    def changed(self, coefficients: Tensor, how: str) -> Tensor:
        """Only all but places on the floor."""
        U = table(common_and_differences, coefficients.shape[1], like=coefficients)
        changed, floor = torch.einsum(how, U, coefficients), TCDIFFPP.floor
        changed[..., floor] = coefficients[..., floor]
        return changed

    def std_with_modes(self, std: Tensor) -> Tensor:
        r"""$\sigma\sqrt{1 + (n-1)\rho}$ of what all do, $\sigma\sqrt{1-\rho}$ of differences.

        Shapes: std (b, n, k, d) -> the same.
        """
        common, differences = 1 + (std.shape[1] - 1) * self.rho, 1 - self.rho
        changed = torch.cat([std[:, :1] * common.sqrt(), std[:, 1:] * differences.sqrt()], dim=1)
        changed[..., TCDIFFPP.floor] = std[..., TCDIFFPP.floor]
        return changed


class UnisonPrior(Part):
    r"""A Gaussian over a group in which any two dancers are equally alike.

    $$\tilde c_r = \sum_n U_{nr}\,c_n, \qquad \tilde\sigma_1^2 = \sigma^2\,(1 + (n-1)\rho), \qquad
      \tilde\sigma_{r>1}^2 = \sigma^2\,(1 - \rho)$$

    Dancers of a group do much the same. If the linear guess takes each for itself, it hears a
    common movement under the noise of one dancer; together they hear it under an n-th of that. A
    network finds this out, too, but not in hours.

    Where dancers stand is left to `dancediff.extensions.formation_prior`.

    Source: ours.

    Shapes: see the module's symbols.

    >>> prior, step = UnisonPrior(num_frames=8, dim=151), torch.randn(500, 1, 8, 151)
    >>> prior.fit([step.expand(-1, 3, -1, -1), torch.randn(500, 3, 8, 151)])  # half in unison
    >>> round(prior.rho.mean().item(), 1)
    0.5
    """

    rho: Tensor

    def __init__(self, num_frames: int, dim: int):
        """Until it is fitted nobody is like the others."""
        super().__init__()
        self.register_buffer("rho", torch.zeros(num_frames, dim))

    @torch.no_grad()
    def fit(self, windows: Iterable[Tensor], weights: Iterable[float] | None = None) -> None:
        """Learn from clean windows (w, n, f, d), normalised and less their mean.

        ``weights``: how much a window of each element counts; by default all count the same.
        """
        together, alone = torch.zeros(()), torch.full((), SMALLEST**2)
        for x, weight in zip(windows, weights or repeat(1.0), strict=weights is not None):
            n = x.shape[1]
            if n > 1:
                c = (table(dct_matrix, x.shape[2], like=x) @ x).double()
                own = c.square().sum(1)  # (w, k, d)
                pairs = c.sum(1).square() - own  # each pair twice
                together = together + weight * pairs.sum(0) / (n * (n - 1))
                alone = alone + weight * own.sum(0) / n
        self.rho.copy_((together / alone).clamp(0, MOST))

    def prepare(self, run: Pass) -> None:
        """Tell preconditioning how alike dancers are."""
        f, known = run.x_t.shape[2], len(self.rho)
        rows = (torch.arange(f, device=self.rho.device) * known) // f  # of a shorter window
        run.modes.append(UnisonModes(self.rho[rows]))
