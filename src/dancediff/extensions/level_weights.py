r"""Noise levels count in the losses by how little a linear guess misses there.

$$w_t = \Big(\frac{\mathbb E_s\, e_s}{e_t}\Big)^p$$

e is the mean square error of the linear guess. Where nearly everything is noise it is a hundred
times larger than where nearly nothing is. Counted the same (p = 0), as in the papers, the last
steps, which decide whether a dance trembles, are hardly trained; with p = 1 they take the network
from those that decide when to step.

Source: EDM section 5 (there $1 / c_\text{out}^2$, which is p = 1).
"""

from dataclasses import replace

import torch
from torch import Tensor

from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.nn.dance_network import DanceNetwork
from dancediff.nn.losses import Comparison


def level_weights(error: Tensor, power: float) -> Tensor:
    """The weight of each noise level, (T,) -> (T,).

    >>> level_weights(torch.tensor([0.25, 4.0, 1.0, 10.75]), power=0.5)
    tensor([4.0000, 1.0000, 2.0000, 0.6100])
    """
    return (error.mean() / error) ** power


def weights_of(model: DanceNetwork, power: float) -> Tensor | None:
    """The weights for a model, (T,); None for ``power=0``.

    Raises: ValueError for a model without preconditioning, which makes no linear guess.
    """
    if not power:
        return None
    known = preconditioning_of(model)
    if known is None:
        raise ValueError(f"level_weights={power} needs a model with preconditioning; use 0")
    return level_weights(known.error(model.abar.float()), power).cpu()


def draw_levels(weights: Tensor, b: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Noise levels t of b rows, on the CPU, and what each row counts in the losses, both (b,).

    A level is drawn in proportion to the root of its weight and counts for the rest of it: the same
    losses in the mean as of even draws, but fewer rows that hardly count.
    """
    odds = weights.sqrt()
    t = torch.multinomial(odds, b, replacement=True, generator=generator)
    return t, weights[t] / odds[t] * odds.mean()


def weigh_rows(c: Comparison, weight: Tensor) -> Comparison:
    """Scale motion and joints of each row, so that it counts by its weight (b,) in every loss.

    Losses are quadratic in them, hence the root of the weight; contacts stay as they are.
    """

    def scaled(x: Tensor) -> Tensor:
        return x * weight.sqrt().reshape(-1, *(1,) * (x.ndim - 1))

    names = ("x_raw", "x_hat", "x_0", "root", "joints", "root_0", "joints_0")
    return replace(c, **{name: scaled(getattr(c, name)) for name in names})
