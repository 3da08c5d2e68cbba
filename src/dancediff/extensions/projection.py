"""Projections: guesses changed as dances in metres, once they are more signal than noise.

Read first: notebook 09 · `dancediff.extensions.foot_contact_projection`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from torch import Tensor

from dancediff.diffusion.long_sampling import Segment
from dancediff.motion.representation import TCDIFFPP, MotionSpec, Normalizer

MORE_SIGNAL = 0.5  # abar from which a guess says more than "on average"


@dataclass(frozen=True)
class Fixed:
    """What a projection must leave as it is: entries (n, f, d) bool, or None for nothing."""

    mask: Tensor | None = None
    spec: MotionSpec = TCDIFFPP

    def frames(self, channels) -> Tensor | None:
        """Frames in which any of these channels is fixed (n, f); None where nothing is."""
        return None if self.mask is None else self.mask[..., channels].any(-1)

    @property
    def height(self) -> Tensor | None:
        """Frames in which the root keeps its height."""
        return self.frames([self.spec.height])

    @property
    def place(self) -> Tensor | None:
        """Frames in which the root keeps its place on the floor."""
        return self.frames(self.spec.floor)


@dataclass(frozen=True)
class Projection:
    """The hook that runs ``steps``, one after the other, on a guess in metres.

    ``steps``: functions of the dance (..., f, d), metres and 6-D rotations, and what is `Fixed`.

    >>> import torch
    >>> higher = lambda x, fixed: x + 1
    >>> hook = Projection(Normalizer(torch.zeros(1), torch.full((1,), 2.0)), [higher])
    >>> [hook.apply(torch.zeros(1, 1, 9, 1), abar).mean().item() for abar in (0.4, 0.6)]
    [0.0, 1.0]
    """

    normalizer: Normalizer
    steps: Sequence[Callable[[Tensor, Fixed], Tensor]]
    fixed: Fixed = field(default_factory=Fixed)

    def for_segment(self, segment: Segment) -> "Projection":
        """The same for a segment of a long dance, whose given entries stay."""
        return replace(self, fixed=replace(self.fixed, mask=segment.mask))

    def apply(self, x0_hat: Tensor, abar: float) -> Tensor:
        """Project a guess (..., f, d), normalised."""
        if abar < MORE_SIGNAL:
            return x0_hat
        x = self.normalizer.unnormalize(x0_hat)
        for step in self.steps:
            x = step(x, self.fixed)
        return self.normalizer.normalize(x)
