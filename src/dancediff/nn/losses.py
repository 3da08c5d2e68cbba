"""What the losses of all papers share: a guess beside the truth, pairs, and the sum of terms.

Symbols (axes: f frames · d motion features · j joints; any axes in front of f)
    x_0                  the true motion, normalised                     (..., f, d)
    x_raw, x_hat         a guess before and after its feet are adapted   (..., f, d)
    contact, contact_0   about 0..1, of the guess and of the truth       (..., f, 4)
    root, root_0         metres                                          (..., f, 3)
    joints, joints_0     forward kinematics, metres                      (..., f, j, 3)
"""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from dancediff.motion.representation import TCDIFFPP, MotionSpec, Normalizer, joints_of
from dancediff.nn.attention import full_precision


class TermWeights(Protocol):
    """The weights of a paper's losses; a frozen dataclass."""

    def terms(self) -> dict[str, float]:
        """The weights by the name of their term."""
        ...


@dataclass(frozen=True)
class Comparison:
    """A guess and the truth in every form that losses compare; made by `compare`."""

    x_raw: Tensor
    x_hat: Tensor
    x_0: Tensor
    contact: Tensor
    root: Tensor
    joints: Tensor
    contact_0: Tensor
    root_0: Tensor
    joints_0: Tensor


def compare(
    x_raw: Tensor, x_hat: Tensor, x_0: Tensor, normalizer: Normalizer, spec: MotionSpec = TCDIFFPP
) -> Comparison:
    """A guess and the truth, with contacts, roots and joints of both; those of x_hat for the guess.

    Differs: forward kinematics are in metres; the official code runs them on normalised values.

    Shapes: x_raw, x_hat, x_0 (..., f, d) normalised, with the d of ``spec``.

    >>> x = torch.rand(2, 8, 151)
    >>> compare(x, x, x, Normalizer(-torch.ones(151), torch.ones(151))).joints.shape
    torch.Size([2, 8, 24, 3])
    """
    y = normalizer.unnormalize(full_precision(x_hat))
    joints = joints_of(y, spec)
    with torch.no_grad():  # the truth needs no graph; recording one nearly doubled the time
        y_0 = normalizer.unnormalize(full_precision(x_0))
        joints_0 = joints_of(y_0, spec)
    return Comparison(
        x_raw=x_raw,
        x_hat=x_hat,
        x_0=x_0,
        contact=y[..., spec.contact],
        root=y[..., spec.root],
        joints=joints,
        contact_0=y_0[..., spec.contact],
        root_0=y_0[..., spec.root],
        joints_0=joints_0,
    )


def mean(error: Tensor) -> Tensor:
    """Mean over everything; 0 of nothing, as of the changes from frame to frame of one frame.

    >>> mean(torch.zeros(1, 0)).item()
    0.0
    """
    return error.mean() if error.numel() else error.sum()


def between_pairs(p: Tensor) -> Tensor:
    """$p_i - p_j$ of all pairs of dancers i < j: (b, n, f, c) -> (b, n (n - 1) / 2, f, c).

    >>> between_pairs(torch.tensor([5.0, 3.0, 0.0])[None, :, None, None]).flatten().tolist()
    [2.0, 5.0, 3.0]
    """
    n = p.shape[1]
    i, j = torch.triu_indices(n, n, 1, device=p.device)
    return p[:, i] - p[:, j]


def with_total(terms: dict[str, Tensor], weights: dict[str, float]) -> dict[str, Tensor]:
    """The terms and their weighted sum "total"; a term of weight 0 costs no backward pass.

    >>> with_total({"a": torch.tensor(2.0), "b": torch.tensor(5.0)}, {"a": 3.0, "b": 0.0})["total"]
    tensor(6.)
    """
    used = [weight * terms[name] for name, weight in weights.items() if weight]
    zero = next(iter(terms.values())).new_zeros(())
    return terms | {"total": sum(used, zero)}
