r"""Planting: when in sampling bodies are put on the floor, and legs under feet that stand.

Read first: notebook 09 · `dancediff.motion.foot_planting` · `dancediff.motion.ground`.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    x0_hat  a guess, normalised                        (b, n, f, d)
    abar    signal power at the step it was made       float
    legs    frames whose legs must stay as they are    (n, f) bool
    height  frames whose root must keep its height     (n, f) bool
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dancediff.diffusion.constraint import Constraint
from dancediff.motion.foot_planting import plant_feet
from dancediff.motion.ground import stand_on_floor
from dancediff.motion.representation import TCDIFFPP, MotionSpec, Normalizer
from dancediff.motion.skeleton import SMPL24

FEET = ("planted", "free")
MORE_SIGNAL = 0.5  # abar from which a guess says more than "on average"
LEGS = [SMPL24.index(side + part) for side in "lr" for part in ("hip", "knee", "ankle", "toe")]


@dataclass(frozen=True)
class Planting:
    """`stand_on_floor` and `plant_feet` for guesses that are more signal than noise.

    >>> norm = Normalizer(-torch.ones(151), torch.ones(151))
    >>> x = torch.randn(1, 2, 30, 151)
    >>> torch.equal(Planting(norm)(x, abar=0.4), x), torch.equal(Planting(norm)(x, abar=0.9), x)
    (True, False)
    """

    normalizer: Normalizer
    legs: Tensor | None = None
    height: Tensor | None = None
    spec: MotionSpec = TCDIFFPP

    def __call__(self, x0_hat: Tensor, abar: float) -> Tensor:
        """Plant the feet of x0_hat."""
        if abar < MORE_SIGNAL:
            return x0_hat
        x = self.normalizer.unnormalize(x0_hat)
        legs, height = (None if m is None else m.to(x.device) for m in (self.legs, self.height))
        x = plant_feet(stand_on_floor(x, height, self.spec), legs, self.spec)
        return self.normalizer.normalize(x)

    def rows(self, part: slice) -> "Planting":
        """The part for some rows of the masks, to sample them in chunks."""
        legs, height = (None if m is None else m[part] for m in (self.legs, self.height))
        return replace(self, legs=legs, height=height)


def held(told: Constraint | None, known: int, n: int, f: int) -> dict[str, Tensor]:
    """Frames that are known: the first ones, and where a constraint says so; each (n, f) bool.

    >>> held(None, 2, n=1, f=4)["legs"]
    tensor([[ True,  True, False, False]])
    """
    first = (torch.arange(f) < known).expand(n, f)
    channels = {"legs": TCDIFFPP.joint_channels(LEGS), "height": [TCDIFFPP.root.start + 1]}
    return {
        part: first if told is None else first | told.mask[..., some].any(-1).cpu()
        for part, some in channels.items()
    }


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
