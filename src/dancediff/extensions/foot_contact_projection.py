"""Foot-contact projection: feet that stand do not slide.

Read first: notebook 09 · `dancediff.motion.foot_locking`.
"""

import torch
from torch import Tensor

from dancediff.extensions.floor_contact import floor_contact
from dancediff.extensions.projection import Fixed, Projection
from dancediff.extensions.speed_limit import speed_limit
from dancediff.motion.foot_locking import plant_feet
from dancediff.motion.representation import TCDIFFPP, MotionSpec, Normalizer
from dancediff.motion.skeleton import SMPL24

LEGS = [SMPL24.index(side + part) for side in "lr" for part in ("hip", "knee", "ankle", "toe")]


def foot_contact_projection(x: Tensor, fixed: Fixed) -> Tensor:
    """Move legs and root so that the feet which x itself says are standing do stand.

    Shapes: x (..., f, d) metres and 6-D rotations -> the same.
    """
    legs, rooted = fixed.frames(fixed.spec.joint_channels(LEGS)), None
    if legs is not None:
        level = legs | fixed.place
        rooted = torch.stack([level, legs | fixed.height, level], -1)
    return plant_feet(x, legs, fixed.spec, rooted=rooted)


def foot_contact_hook(
    normalizer: Normalizer, mask: Tensor | None = None, spec: MotionSpec = TCDIFFPP
) -> Projection:
    """What ``foot_contact=True`` stands for: speed limit, floor contact, standing feet.

    >>> norm = Normalizer(-torch.ones(151), torch.ones(151))
    >>> x, hook = torch.randn(1, 2, 30, 151), foot_contact_hook(norm)
    >>> torch.equal(hook.apply(x, abar=0.4), x), torch.equal(hook.apply(x, abar=0.9), x)
    (True, False)
    """
    steps = (speed_limit, floor_contact, foot_contact_projection)
    return Projection(normalizer, steps, Fixed(mask, spec))
