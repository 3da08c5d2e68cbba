"""Segments: the windows of a long dance, and the music of each."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor

from dancediff.axes import FPS
from dancediff.generation.segmented_request import SegmentedRequest
from dancediff.generation.tcdiffpp_request import TCDiffPPRequest


@dataclass(frozen=True)
class SegmentPlan:
    """Windows of ``window`` frames that share ``overlap`` frames and cover a dance.

    >>> SegmentPlan(frames=720, window=150, overlap=75).count  # the papers' evaluation length
    9
    """

    frames: int
    window: int
    overlap: int

    @classmethod
    def of(cls, request: SegmentedRequest, window: int) -> "SegmentPlan":
        """Of a resolved request."""
        return cls(request.frames, window, request.overlap)

    @property
    def stride(self) -> int:
        """Frames that every segment adds."""
        return self.window - self.overlap

    @property
    def count(self) -> int:
        """How many there are; the last may reach beyond the dance's end."""
        return 1 + max(0, math.ceil((self.frames - self.window) / self.stride))

    def carrying_out(self, swap_at: float | None) -> int:
        """Which segment carries out a swap: the first that ends at ``swap_at`` seconds or later.

        By default it is the last one that ends within the dance, so that the whole swap is seen.

        >>> SegmentPlan(frames=600, window=150, overlap=75).carrying_out(None)
        6
        >>> SegmentPlan(frames=300, window=150, overlap=75).carrying_out(6)
        1
        """
        if swap_at is None:
            chosen = (self.frames - self.window) // self.stride
        else:
            chosen = math.ceil((swap_at * FPS - self.window) / self.stride)
        return min(max(chosen, 0), self.count - 1)

    def music(self, M: Tensor) -> Tensor:
        """The music of each segment; behind the song's end it starts again.

        What is danced to the repeated part is cut off later, but the window needs some music there.

        Shapes: M (F, m) -> (count, window, m).

        >>> M = Tensor(range(5))[:, None]
        >>> SegmentPlan(frames=6, window=4, overlap=2).music(M)[..., 0].tolist()
        [[0.0, 1.0, 2.0, 3.0], [2.0, 3.0, 4.0, 0.0]]
        """
        return self.whole(M).unfold(0, self.window, self.stride).transpose(1, 2)

    def whole(self, M: Tensor) -> Tensor:
        """The music of all segments in one piece, (F, m) -> (window + (count - 1) stride, m)."""
        needed = self.window + self.stride * (self.count - 1)
        return M.repeat(-(-needed // len(M)), 1)[:needed]

    def targets(self, request: TCDiffPPRequest) -> Sequence[Sequence[int] | None]:
        """The order asked for at the end of each segment, or None; nothing without a swap."""
        if request.swap is None:
            return ()
        orders: list[Sequence[int] | None] = [None] * self.count
        orders[self.carrying_out(request.swap_at)] = request.swap
        return orders

    def seams(self, resampled: int = 0) -> list[int]:
        """Frames in which a segment takes over from the one before; metrics look there.

        >>> SegmentPlan(frames=270, window=150, overlap=75).seams()
        [150, 225]
        """
        first = self.window - resampled
        return [first + k * self.stride for k in range(self.count - 1)]
