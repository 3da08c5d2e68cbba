"""Speed limit: joints turn and dancers travel no faster than bodies do.

Read first: notebook 09 · `dancediff.motion.joint_speed_limit` ·
`dancediff.motion.travel_speed_limit`.
"""

from torch import Tensor

from dancediff.extensions.projection import Fixed
from dancediff.motion.joint_speed_limit import limit_turns
from dancediff.motion.travel_speed_limit import limit_travel


def speed_limit(x: Tensor, fixed: Fixed) -> Tensor:
    """Spread what is too fast over more frames; slower dancers are returned unchanged.

    Shapes: x (..., f, d) metres and 6-D rotations -> the same.
    """
    x = limit_turns(x, fixed.frames(fixed.spec.rot6d), fixed.spec)
    return limit_travel(x, fixed.place, fixed.spec)
