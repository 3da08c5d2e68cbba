"""Floor contact: bodies neither float nor sink.

Read first: notebook 09 · `dancediff.motion.ground`.
"""

from torch import Tensor

from dancediff.extensions.projection import Fixed
from dancediff.motion.ground import stand_on_floor


def floor_contact(x: Tensor, fixed: Fixed) -> Tensor:
    """Put bodies on the floor; only the height of the root changes, and leaps stay.

    Shapes: x (..., f, d) metres and 6-D rotations -> the same.
    """
    return stand_on_floor(x, fixed.height, fixed.spec)
