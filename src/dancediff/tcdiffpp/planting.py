r"""Planting: when in sampling the legs are brought under feet that stand.

Read first: notebook 09 · `dancediff.motion.foot_planting`.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    x0_hat  a guess, normalised                        (b, n, f, d)
    abar    signal power at the step it was made       float
    held    frames whose legs must stay as they are    (n, f) bool
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dancediff.diffusion.constraint import Constraint
from dancediff.motion.foot_planting import plant_feet
from dancediff.motion.representation import TCDIFFPP, MotionSpec, Normalizer
from dancediff.motion.skeleton import SMPL24

FEET = ("planted", "free")
MORE_SIGNAL = 0.5  # abar from which a guess says more than "on average"
LEGS = [SMPL24.index(side + part) for side in "lr" for part in ("hip", "knee", "ankle", "toe")]


@dataclass(frozen=True)
class Planting:
    """`plant_feet` for the guesses of a sampler, once they are more signal than noise.

    >>> norm = Normalizer(-torch.ones(151), torch.ones(151))
    >>> x = torch.randn(1, 2, 30, 151)
    >>> torch.equal(Planting(norm)(x, abar=0.4), x), torch.equal(Planting(norm)(x, abar=0.9), x)
    (True, False)
    """

    normalizer: Normalizer
    held: Tensor | None = None
    spec: MotionSpec = TCDIFFPP

    def __call__(self, x0_hat: Tensor, abar: float) -> Tensor:
        """Plant the feet of x0_hat."""
        if abar < MORE_SIGNAL:
            return x0_hat
        x = self.normalizer.unnormalize(x0_hat)
        held = None if self.held is None else self.held.to(x.device)
        return self.normalizer.normalize(plant_feet(x, held, self.spec))

    def rows(self, part: slice) -> "Planting":
        """The part for some rows of held, to sample them in chunks."""
        return self if self.held is None else replace(self, held=self.held[part])


def held_legs(told: Constraint | None, known: int, n: int, f: int) -> Tensor:
    """Frames whose legs are known: the first ones, and where a constraint says so, (n, f) bool.

    >>> held_legs(None, 2, n=1, f=4)
    tensor([[ True,  True, False, False]])
    """
    held = torch.zeros(n, f, dtype=torch.bool)
    held[:, :known] = True
    if told is not None:
        held |= told.mask[..., TCDIFFPP.joint_channels(LEGS)].any(-1).cpu()
    return held


def one_after_the_other(*bends: Callable | None) -> Callable | None:
    """Several ``bend(x0_hat, abar)`` of `sample` as one; None where there is none.

    >>> one_after_the_other(None, lambda x, abar: x + 1, lambda x, abar: x * abar)(2.0, 0.5)
    1.5
    """
    steps = [bend for bend in bends if bend is not None]
    if not steps:
        return None

    def bend(x0_hat, abar):
        for step in steps:
            x0_hat = step(x0_hat, abar)
        return x0_hat

    return bend
