r"""Constraints: what is known about a dance before it is sampled.

Read first: notebook 10 · Song et al. 2023 ("Pseudoinverse-guided diffusion models") eq. 7.

Symbols (axes: n dancers · f frames · d motion features, normalised · k frequencies)
    mask     which entries are known                                   (n, f, d) bool
    value    what they are                                             (n, f, d)
    slack    how far off they may be, as a standard deviation          (n, f, d)
    spread   of each frequency over the training set                   (k, d)
    cov      covariance of what a guess still misses, between all frames and the known ones
                                                                       (d, f, c)
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from dancediff.extensions.preconditioning import dct_matrix, linear_coefficients
from dancediff.lookup import table

JITTER = 1e-9  # of the largest variance; keeps the equations solvable where frames are redundant


@dataclass(frozen=True)
class Constraint:
    r"""Known entries of a dance, in normalised features; everything else is free.

    The network's guess is bent to the known entries in the way a dance could really bend:

    $$\hat x_0 \leftarrow \hat x_0 + \Sigma_t A^\top (A \Sigma_t A^\top + \text{slack}^2)^{-1}
      (y - A \hat x_0)$$

    A picks the known entries and y is what they are. $\Sigma_t$, what a guess may still miss after
    t steps of noise, is that of the linear guess (`Preconditioning`): wide and slow while noise is
    strong, narrow in the end. So a place to be at in the last frame first turns the whole path and
    later only its end, and a frame to pass through is met without a jump. Since the bent guess is
    what the next noisy motion is made from, the network sees the constraint and dances to it.

    Source: ours, after Song et al. 2023; they take $\Sigma_t$ as a multiple of the identity.
    Differs: pasting the known entries in after each step (RePaint, EDGE, the released code) leaves
    the free entries where the network guessed them, so that feet slide and roots jump at the edge.

    Shapes: mask, value, slack (n, f, d).
    Raises: ValueError when shapes differ or a known value is not finite.

    >>> mask = torch.zeros(1, 150, 1, dtype=torch.bool)
    >>> mask[:, 149] = True                                    # be at 1 in the last frame
    >>> be_there = Constraint(mask, torch.ones(1, 150, 1))
    >>> spread = 1 / (1 + torch.arange(150.0)[:, None]) ** 2   # slow parts are large
    >>> bent = be_there.bend(torch.zeros(1, 1, 150, 1), abar=0.5, spread=spread).flatten()
    >>> round(bent[149].item(), 4), bool(bent.diff().abs().max() < 0.05)
    (1.0, True)
    """

    mask: Tensor
    value: Tensor
    slack: Tensor | None = None

    def __post_init__(self):
        parts = {"value": self.value, "slack": self.slack}
        for name, part in parts.items():
            if part is not None and part.shape != self.mask.shape:
                raise ValueError(
                    f"{name} has shape {tuple(part.shape)}, mask {tuple(self.mask.shape)}; "
                    "both are (n, f, d)"
                )
        if not self.value[self.mask].isfinite().all():
            raise ValueError("value has entries that are not finite where mask says they are known")

    def frames(self, start: int, stop: int) -> "Constraint":
        """The part for a window; frames beyond the end are free."""

        def cut(part: Tensor) -> Tensor:
            inside = part[:, start:stop]
            beyond = part.new_zeros(len(part), stop - start - inside.shape[1], part.shape[2])
            return torch.cat([inside, beyond], 1)

        return self._each(cut)

    def dancers(self, order: Tensor) -> "Constraint":
        """The same for dancers in another order."""
        return self._each(lambda part: part[order])

    def _each(self, change) -> "Constraint":
        slack = None if self.slack is None else change(self.slack)
        return Constraint(change(self.mask), change(self.value), slack)

    @property
    def looseness(self) -> Tensor:
        """``slack``, zero where none was given (n, f, d)."""
        return torch.zeros_like(self.value) if self.slack is None else self.slack

    def over(self, other: "Constraint") -> "Constraint":
        """Both; where both know an entry, this one is believed."""
        return Constraint(
            self.mask | other.mask,
            torch.where(self.mask, self.value, other.value),
            torch.where(self.mask, self.looseness, other.looseness),
        )

    @cached_property
    def groups(self) -> list[tuple[Tensor, Tensor, Tensor, Tensor]]:
        """What is known in the same frames with the same slack: (dancers (p,), features (p,),
        the frames (c,), their slack (c,)) for each group; one gain serves all of it."""
        n, d = self.mask.any(1).nonzero(as_tuple=True)
        if len(n) == 0:
            return []
        rows = torch.where(self.mask, self.looseness, -1.0)[n, :, d]
        rows, kind = rows.unique(dim=0, return_inverse=True)
        return [
            (n[kind == k], d[kind == k], (row >= 0).nonzero()[:, 0], row[row >= 0])
            for k, row in enumerate(rows)
        ]

    def bend(self, x0_hat: Tensor, abar: float, spread: Tensor) -> Tensor:
        """Bend a guess (b, n, f, d) to the known entries, at noise level ``abar``."""
        x, device = x0_hat.double(), x0_hat.device  # neighbouring frames are nearly redundant
        bent = x.clone()
        for n, d, frames, slack in self.groups:
            features, place = d.unique(return_inverse=True)
            cov = covariance(abar, spread[:, features.to(spread.device)].to(x), x.shape[2], frames)
            K = gain(cov, frames, slack.to(cov))[place.to(device)]  # (p, f, c)
            known = self.value[n, :, d][:, frames].to(x)  # (p, c)
            missed = known - x[:, n, :, d][:, :, frames].transpose(0, 1)  # (b, p, c)
            bent[:, n, :, d] += torch.einsum("pfc,bpc->pbf", K, missed)
        return bent.to(x0_hat)


@dataclass(frozen=True)
class Bending:
    """The ``bend`` of `samplers.sample`: what is told of a dance, and what its guesses call for.

    ``rules`` look at a guess (n, f, d) and its noise level and say what should be otherwise, as a
    `Constraint`, or None. What is told is believed over all rules, a rule over those behind it.

    >>> lift = lambda x, abar: Constraint(x < 1, torch.ones_like(x))
    >>> bend = Bending(torch.ones(4, 1), rules=(lift,))
    >>> bend(torch.zeros(1, 1, 4, 1), abar=0.5).flatten().round().tolist()
    [1.0, 1.0, 1.0, 1.0]
    """

    spread: Tensor
    told: Constraint | None = None
    rules: tuple[Callable[[Tensor, float], Constraint | None], ...] = ()

    def __call__(self, x0_hat: Tensor, abar: float) -> Tensor:
        """Bend a guess (1, n, f, d) made at noise level ``abar``; without rules any batch."""
        asked = self.told
        for rule in self.rules:
            more = rule(x0_hat[0], abar)
            if more is not None:
                asked = more if asked is None else asked.over(more)
        return x0_hat if asked is None else asked.bend(x0_hat, abar, self.spread)


def covariance(abar: float, spread: Tensor, f: int, frames: Tensor) -> Tensor:
    r"""What the linear guess still misses: how all frames vary with those given.

    $$\Sigma = C^\top \operatorname{diag}(c_\text{out}^2)\, C$$

    Shapes: spread (k, d), frames (c,) -> columns of it (d, f, c).
    """
    rows = (torch.arange(f, device=spread.device) * len(spread)) // f
    _, scale = linear_coefficients(torch.as_tensor(abar).to(spread), spread[rows])
    C = table(dct_matrix, f, like=spread)
    return C.T @ (scale.T[:, :, None] ** 2 * C[:, frames])


def gain(cov: Tensor, frames: Tensor, slack: Tensor) -> Tensor:
    r"""How every frame follows when the known ones are corrected.

    $$K = \Sigma A^\top (A \Sigma A^\top + \text{slack}^2)^{-1}$$

    Shapes: cov (d, f, c), frames and slack (c,) -> (d, f, c).
    """
    among = cov[:, frames]
    largest = among.diagonal(dim1=1, dim2=2).amax(1)[:, None]
    noise = torch.diag_embed(slack**2 + JITTER * largest)
    return torch.cholesky_solve(cov.mT, torch.linalg.cholesky(among + noise)).mT
