r"""From a song to the segments of a dance.

Read first: Lodge section 3.2 and "Parallel Inference".

Symbols (axes: F frames of the dance · m music features)
    N, n   frames of a global and of a local segment, 1024 and 256
    G, L   how many of them a song has

A song of 2100 frames (the last local goes beyond its end and is cut off; the last global is moved
back so that it ends with the last local):

    locals    |0    |256  |512  |768  |1024 |1280 |1536 |1792 |2048 |
    globals   |0                      |1024                   |
                                            |1280                   |
"""

import operator
from dataclasses import dataclass, field

import torch
from torch import Tensor

from dancediff.papers.lodge.primitives import LAYOUT, Layout


@dataclass(frozen=True)
class Segments:
    """First frames of all global and local segments of a dance of ``frames`` frames."""

    frames: int
    globals: tuple[int, ...]
    locals: tuple[int, ...]
    layout: Layout = field(default=LAYOUT, repr=False)

    @property
    def seams(self) -> list[int]:
        """Frames of the dance in which a local takes over from the one before."""
        return list(self.locals[1:])

    @property
    def shared(self) -> list[int]:
        """How many locals of each global were already in the global before it."""
        n, done, shared = self.layout.local_frames, 0, []
        for start in self.globals:
            shared.append(done - start // n)
            done = start // n + self.layout.locals_per_global
        return shared

    def global_music(self, M: Tensor, part: slice = slice(None)) -> Tensor:
        """Music of some globals, (F, m) -> (G, N, m); behind its end the song starts again."""
        return self._cut(M, self.globals[part], self.layout.global_frames)

    def local_music(self, M: Tensor, part: slice = slice(None)) -> Tensor:
        """Music of some locals, (F, m) -> (L, n, m); behind its end the song starts again."""
        return self._cut(M, self.locals[part], self.layout.local_frames)

    def _cut(self, M: Tensor, starts: tuple[int, ...], length: int) -> Tensor:
        if len(M) < self.frames:
            raise ValueError(f"M has {len(M)} frames, the dance {self.frames}; make it shorter")
        rows = torch.tensor(starts)[:, None] + torch.arange(length)
        return M[rows.to(M.device) % len(M)]


def segments_of(frames: int, layout: Layout = LAYOUT) -> Segments:
    r"""Cut a dance of any length into segments.

    $$L = \lceil F / n \rceil, \qquad G = \lceil L\,n / N \rceil$$

    Globals follow one another; the last one ends with the last local, and so may lie over some of
    the global before. A song shorter than N has one global, with the song over again at its end.

    Source: Lodge's code.  Differs: it drops what is left after the last whole local, and refuses
    songs shorter than N.

    Raises: ValueError for less than 1 frame.

    >>> long = segments_of(2100)
    >>> long.globals, len(long.locals), segments_of(300).locals
    ((0, 1024, 1280), 9, (0, 256))
    """
    frames = operator.index(frames)
    if frames < 1:
        raise ValueError(f"frames={frames} is no length; a dance has at least 1 frame")
    N, n = layout.global_frames, layout.local_frames
    L = -(-frames // n)
    last = max(0, L * n - N)
    starts = [min(start, last) for start in range(0, L * n, N)]
    return Segments(frames, tuple(starts), tuple(range(0, L * n, n)), layout)
