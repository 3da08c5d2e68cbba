"""Initial frames: a segment starts where, and as fast as, the segment before ended.

Read first: notebook 10 · `dancediff.extensions.constraint` · `dancediff.diffusion.pinning`.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from dancediff.diffusion.long_sampling import Segment
from dancediff.extensions.constraint import Constraint

FRAMES = 8  # the last of the context: they say where and how fast a segment starts


@dataclass(frozen=True)
class InitialFrames:
    """For `ConstraintHook`: the last frames of the context, as a constraint of the segment.

    Pinning holds the context in the noisy motion; the guess, and with it the frames that follow,
    would still start somewhere else.
    """

    frames: int = FRAMES

    def for_segment(self, segment: Segment) -> Constraint | None:
        """The constraint of a segment; None for the first one, which has no context."""
        if segment.context is None:
            return None
        context = segment.context.cpu()
        k = context.shape[1]
        mask = torch.zeros(segment.shape, dtype=torch.bool)
        value = torch.zeros(segment.shape, dtype=context.dtype)
        mask[:, max(0, k - self.frames) : k] = True
        value[:, :k] = context
        return Constraint(mask, value)

    def at(self, guess: Tensor, abar: float) -> None:
        """As a `Source`: nothing before the segment is known."""
