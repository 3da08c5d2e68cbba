r"""Planting: what bodies cannot do is taken out of the guesses of a sampler.

Joints do not turn too fast (`dancediff.motion.joint_speed_limit`), nobody dashes
(`dancediff.motion.travel_speed_limit`), bodies do not float (`dancediff.motion.ground`), feet that
stand do
not slide (`dancediff.motion.foot_locking`).

Read first: notebook 09.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    x0_hat  a guess, normalised                        (b, n, f, d)
    abar    signal power at the step it was made       float
    legs    frames whose legs must stay as they are    (n, f) bool
    height  frames whose root must keep its height     (n, f) bool
    turns   frames whose rotations must stay           (n, f) bool
    places  frames whose place on the floor must stay  (n, f) bool
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from dancediff.extensions.constraint import Constraint
from dancediff.motion.foot_locking import plant_feet
from dancediff.motion.ground import stand_on_floor
from dancediff.motion.joint_speed_limit import limit_turns
from dancediff.motion.representation import TCDIFFPP, MotionSpec, Normalizer
from dancediff.motion.skeleton import SMPL24
from dancediff.motion.travel_speed_limit import limit_travel

FEET = ("planted", "free")
MORE_SIGNAL = 0.5  # abar from which a guess says more than "on average"
LEGS = [SMPL24.index(side + part) for side in "lr" for part in ("hip", "knee", "ankle", "toe")]


@dataclass(frozen=True)
class Planting:
    """`limit_turns` ... `plant_feet` for guesses that are more signal than noise.

    >>> norm = Normalizer(-torch.ones(151), torch.ones(151))
    >>> x = torch.randn(1, 2, 30, 151)
    >>> torch.equal(Planting(norm)(x, abar=0.4), x), torch.equal(Planting(norm)(x, abar=0.9), x)
    (True, False)
    """

    normalizer: Normalizer
    legs: Tensor | None = None
    height: Tensor | None = None
    turns: Tensor | None = None
    places: Tensor | None = None
    spec: MotionSpec = TCDIFFPP

    def __call__(self, x0_hat: Tensor, abar: float) -> Tensor:
        """Plant the feet of x0_hat."""
        if abar < MORE_SIGNAL:
            return x0_hat

        def here(mask: Tensor | None) -> Tensor | None:
            return None if mask is None else mask.to(x0_hat.device)

        x = limit_turns(self.normalizer.unnormalize(x0_hat), here(self.turns), self.spec)
        x = limit_travel(x, here(self.places), self.spec)
        x = stand_on_floor(x, here(self.height), self.spec)
        x = plant_feet(x, here(self.legs), self.spec, rooted=here(self.rooted))
        return self.normalizer.normalize(x)

    @property
    def rooted(self) -> Tensor | None:
        """Frames and axes where the root must not follow its feet, (n, f, 3)."""
        masks = [self.legs, self.height, self.places]
        if all(mask is None for mask in masks):
            return None
        none = torch.zeros_like(next(mask for mask in masks if mask is not None))
        legs, height, places = (none if mask is None else mask for mask in masks)
        return torch.stack([legs | places, legs | height, legs | places], -1)


def held(told: Constraint | None, known: int, n: int, f: int) -> dict[str, Tensor]:
    """Frames that are known: the first ones, and where a constraint says so; each (n, f) bool.

    >>> held(None, 2, n=1, f=4)["legs"]
    tensor([[ True,  True, False, False]])
    """
    first = (torch.arange(f) < known).expand(n, f)
    channels = {
        "legs": TCDIFFPP.joint_channels(LEGS),
        "height": [TCDIFFPP.height],
        "turns": TCDIFFPP.rot6d,
        "places": TCDIFFPP.floor,
    }
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
