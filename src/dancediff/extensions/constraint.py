r"""Constraints: what is known about a dance before it is sampled, and guesses conditioned on it.

Read first: notebook 10 · Song et al. 2023 ("Pseudoinverse-guided diffusion models") eq. 7.

Symbols (axes: n dancers · f frames · d motion features, normalised · k frequencies
         c known frames · p features of dancers of which something is known)
    mask     which entries are known                                   (n, f, d) bool
    value    what they are                                             (n, f, d)
    slack    how far off they may be, as a standard deviation          (n, f, d)
    std      of each frequency over the training set                   (k, d)
    cov      covariance of what a guess still misses, between all frames and the known ones
                                                                       (d, f, c)
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import torch
from torch import Tensor

from dancediff.diffusion.long_sampling import Segment
from dancediff.extensions.preconditioning import dct_matrix, linear_coefficients
from dancediff.lookup import table

JITTER = 1e-9  # of the largest variance; keeps the equations solvable where frames are redundant


@dataclass(frozen=True)
class Constraint:
    r"""Known entries of a dance, in normalised features; everything else is free.

    A guess is conditioned on the known entries, as a Gaussian whose mean it is:

    $$\hat x_0 \leftarrow \hat x_0 + \Sigma_t A^\top (A \Sigma_t A^\top + \text{slack}^2)^{-1}
      (y - A \hat x_0)$$

    A picks the known entries and y is what they are. $\Sigma_t$, what a guess may still miss after
    t steps of noise, is that of the linear guess (`Preconditioning`): wide and slow while noise is
    strong, narrow in the end. So a place to be at in the last frame first turns the whole path and
    later only its end, and a frame to pass through is met without a jump. Since the next noisy
    motion is made from the conditioned guess, the network sees the constraint and answers to it.

    Source: ours, after Song et al. 2023; they take $\Sigma_t$ as a multiple of the identity.
    Differs: pasting the known entries in after each step (RePaint, EDGE, the released code) leaves
    the free entries where the network guessed them, so that feet slide and roots jump at the edge.

    Shapes: mask, value, slack (n, f, d).
    Raises: ValueError when mask is not bool, shapes differ or a known value is not finite.

    >>> mask = torch.zeros(1, 150, 1, dtype=torch.bool)
    >>> mask[:, 149] = True                                    # be at 1 in the last frame
    >>> be_there = Constraint(mask, torch.ones(1, 150, 1))
    >>> std = 1 / (1 + torch.arange(150.0)[:, None]) ** 2      # slow parts are large
    >>> x = be_there.condition(torch.zeros(1, 1, 150, 1), abar=0.5, std=std).flatten()
    >>> round(x[149].item(), 4), bool(x.diff().abs().max() < 0.05)
    (1.0, True)
    """

    mask: Tensor
    value: Tensor
    slack: Tensor = None  # type: ignore[assignment] # None becomes zeros

    def __post_init__(self):
        if self.mask.dtype != torch.bool:  # numbers would pick entries by their place
            raise ValueError(f"mask holds {self.mask.dtype}; give mask.bool(), True where known")
        if self.slack is None:
            object.__setattr__(self, "slack", torch.zeros_like(self.value))
        for name in ("value", "slack"):
            part = getattr(self, name)
            if part.shape != self.mask.shape:
                raise ValueError(
                    f"{name} has shape {tuple(part.shape)}, mask {tuple(self.mask.shape)}; "
                    "both are (n, f, d)"
                )
        if not self.value[self.mask].isfinite().all():
            raise ValueError("value has entries that are not finite where mask says they are known")

    def for_segment(self, segment: Segment) -> "Constraint":
        """The part for a segment, in its rows; its context is danced already, and free."""
        f, k = segment.shape[1], 0 if segment.context is None else segment.context.shape[1]

        def part(entries: Tensor) -> Tensor:
            out = entries.new_zeros(segment.shape)
            here = entries[segment.order, segment.start : segment.start + f]
            out[:, k : here.shape[1]] = here[:, k:]
            return out

        return Constraint(part(self.mask), part(self.value), part(self.slack))

    def at(self, guess: Tensor, abar: float) -> "Constraint":
        """As a `Source`: the same of every guess."""
        return self

    def over(self, other: "Constraint") -> "Constraint":
        """Both; where both know an entry, this one is believed."""
        return Constraint(
            self.mask | other.mask,
            torch.where(self.mask, self.value, other.value),
            torch.where(self.mask, self.slack, other.slack),
        )

    @cached_property
    def groups(self) -> list[tuple[Tensor, Tensor, Tensor, Tensor]]:
        """What is known in the same frames with the same slack: (dancers (p,), features (p,),
        the frames (c,), their slack (c,)) for each group; one gain serves all of it."""
        n, d = self.mask.any(1).nonzero(as_tuple=True)
        if len(n) == 0:
            return []
        rows = torch.where(self.mask, self.slack, -1.0)[n, :, d]
        rows, kind = rows.unique(dim=0, return_inverse=True)
        return [
            (n[kind == k], d[kind == k], (row >= 0).nonzero()[:, 0], row[row >= 0])
            for k, row in enumerate(rows)
        ]

    def condition(self, x0_hat: Tensor, abar: float, std: Tensor) -> Tensor:
        """Condition a guess (b, n, f, d) on what is known; ``abar``: the signal left in x_t."""
        x, device = x0_hat.double(), x0_hat.device  # neighbouring frames are nearly redundant
        out = x.clone()
        for n, d, frames, slack in self.groups:
            features, place = d.unique(return_inverse=True)
            cov = covariance(abar, std[:, features.to(std.device)].to(x), x.shape[2], frames)
            K = gain(cov, frames, slack.to(cov))[place.to(device)]  # (p, f, c)
            known = self.value[n, :, d][:, frames].to(x)  # (p, c)
            missed = known - x[:, n, :, d][:, :, frames].transpose(0, 1)  # (b, p, c)
            out[:, n, :, d] += torch.einsum("pfc,bpc->pbf", K, missed)
        return out.to(x0_hat)


class Source(Protocol):
    """Asks for something of a guess."""

    def for_segment(self, segment: Segment) -> "Source | None":
        """The same for a segment of a long dance; None where it asks for nothing there."""
        ...

    def at(self, guess: Tensor, abar: float) -> Constraint | None:
        """What it asks of a guess (n, f, d) made where ``abar`` of the signal is left."""
        ...


def as_good_as_linear(abar: float) -> float:
    r"""The signal power at which a linear guess would miss as much as a network does at ``abar``.

    $$\frac{1 - \bar\alpha'}{\bar\alpha'} = \rho^2\,\frac{1 - \bar\alpha}{\bar\alpha},
      \quad \rho = \frac{1 + 3\bar\alpha^2}{4}$$

    A network misses less, the less the stronger the noise: what the packaged one misses a linear
    guess would miss with a share of the noise over signal, at t = 900, 500 and 150 with 0.27, 0.38
    and 0.57, of what lasts with 0.32, 0.69 and 1.06 (docs/log/run_15.md); $\rho$, 0.25, 0.43 and
    0.91, is chosen in between. Without it a correction reaches frames that the network was right
    about, and all segments of a long dance stay near the pose of their first seam.

    >>> [round(as_good_as_linear(abar), 2) for abar in (0.1, 0.5, 0.9)]
    [0.63, 0.84, 0.92]
    """
    share = (1 + 3 * abar**2) / 4
    return abar / (abar + share**2 * (1 - abar))


@dataclass(frozen=True)
class ConstraintHook:
    """The hook that conditions every guess on what ``sources`` ask for, all at once.

    Earlier sources are believed over later ones.

    - ``std``: of each frequency in the training set.
    - ``as_linear``: the signal power at which the linear guess is as good as the guesses are.

    >>> mask = torch.ones(1, 4, 1, dtype=torch.bool)
    >>> hook = ConstraintHook(torch.ones(4, 1), [Constraint(mask, torch.ones(1, 4, 1))])
    >>> hook.apply(torch.zeros(1, 1, 4, 1), abar=0.5).flatten().round().tolist()
    [1.0, 1.0, 1.0, 1.0]
    """

    std: Tensor
    sources: Sequence[Source]
    as_linear: Callable[[float], float] = as_good_as_linear

    def for_segment(self, segment: Segment) -> "ConstraintHook | None":
        """The same for a segment of a long dance; None where nothing is asked."""
        bound = (source.for_segment(segment) for source in self.sources)
        sources = [source for source in bound if source is not None]
        return replace(self, sources=sources) if sources else None

    def apply(self, x0_hat: Tensor, abar: float) -> Tensor:
        """Condition a guess (b, n, f, d); sources see the first row of the batch."""
        target = None
        for source in self.sources:
            more = source.at(x0_hat[0], abar)
            if more is not None:
                target = more if target is None else target.over(more)
        if target is None:
            return x0_hat
        return target.condition(x0_hat, self.as_linear(abar), self.std)


def covariance(abar: float, std: Tensor, f: int, frames: Tensor) -> Tensor:
    r"""What the linear guess still misses: how all frames vary with those given.

    $$\Sigma = C^\top \operatorname{diag}(c_\text{out}^2)\, C$$

    Shapes: std (k, d), frames (c,) -> columns of it (d, f, c).
    """
    rows = (torch.arange(f, device=std.device) * len(std)) // f
    _, scale = linear_coefficients(torch.as_tensor(abar).to(std), std[rows])
    C = table(dct_matrix, f, like=std)
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
