"""Scales of motion in which noise is small enough where it must be: training's ``metre_unit``.

The papers scale every channel of motion to -1 ... 1 over the training set. With a unit as wide as
the stage, the noise of the last steps is 17 cm on the floor; and a matrix entry that only ever
moves between 0.996 and 1 weighs as much as a knee. So a unit of the floor is a metre, and no
channel's range is taken to be narrower than `MIN_SPAN`.
"""

from torch import Tensor

from dancediff.motion.representation import MotionSpec, Normalizer

FLOOR_UNIT = 1.0  # metres
MIN_SPAN = 0.2  # of a channel's range, in metres or matrix entries


def metre_unit_normalizer(x: Tensor, spec: MotionSpec, *, at_most: bool = False) -> Normalizer:
    """Scales for motion (..., d); ``at_most``: a range on the floor below a metre stays as it is.

    >>> import torch
    >>> from dancediff.motion.representation import TCDIFFPP
    >>> norm = metre_unit_normalizer(3 * torch.rand(9, 151), TCDIFFPP)
    >>> norm.low[4].item(), norm.high[4].item()
    (-1.0, 1.0)
    """
    norm = Normalizer.fit(x, min_span=MIN_SPAN)
    floor = spec.floor
    low, high = norm.low[floor], norm.high[floor]
    norm.low[floor] = low.clamp_min(-FLOOR_UNIT) if at_most else low.new_full((2,), -FLOOR_UNIT)
    norm.high[floor] = high.clamp_max(FLOOR_UNIT) if at_most else high.new_full((2,), FLOOR_UNIT)
    return norm
