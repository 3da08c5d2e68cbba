"""How long the pieces of a stream took."""

from dataclasses import dataclass


@dataclass
class Timing:
    """How long pieces took, in seconds.

    >>> Timing(pieces=2, total=3.0).mean
    1.5
    """

    first: float = float("nan")  # from the call of `stream` to the first piece
    last: float = float("nan")  # the newest piece
    longest: float = 0.0
    total: float = 0.0
    pieces: int = 0

    @property
    def mean(self) -> float:
        """Of all pieces."""
        return self.total / max(self.pieces, 1)

    def add(self, seconds: float) -> None:
        """One more piece."""
        self.last, self.longest = seconds, max(self.longest, seconds)
        self.total, self.pieces = self.total + seconds, self.pieces + 1
