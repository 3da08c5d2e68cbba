r"""A dance of units becomes motion block by block, as soon as no later unit can change a block.

Read first: `dancediff.nn.motion_units`.

Symbols (axes: u units of eight frames · f frames · m music features; any axes in front)
    M       music features                               (f, m)
    block   units that become motion together; counted, as all units here, from the first one of
            the history, which lies before the song
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

from torch import Tensor

from dancediff.autoregression.roll_out import music_window
from dancediff.nn.motion_units import FRAMES, REACH

HISTORY = 4  # units before the first one
BLOCK = 8  # units that become motion together


class Block(NamedTuple):
    """Units that become motion together; ``near``: those that their motion depends on."""

    start: int
    near: slice
    new: slice  # the block's own, among those


def blocks(frames: int) -> Iterator[Block]:
    """The blocks of a dance, in turn; units up to ``near.stop`` must be known for each.

    >>> for block in blocks(frames=100):
    ...     print(block.start, block.near, block.new)
    4 slice(0, 17, None) slice(4, 12, None)
    12 slice(0, 17, None) slice(12, 17, None)
    """
    total = HISTORY + math.ceil(frames / FRAMES)
    for start in range(HISTORY, total, BLOCK):
        end = min(start + BLOCK, total)
        first = max(start - REACH, 0)
        near = slice(first, min(end + REACH, total))
        yield Block(start, near, slice(start - first, end - first))


def frames_of(units: slice) -> slice:
    """The frames of some units.

    >>> frames_of(slice(2, None))
    slice(16, None, None)
    """
    return slice(*(None if at is None else FRAMES * at for at in (units.start, units.stop)))


def unit_music(M: Tensor) -> Tensor:
    """The music of a unit's eight frames side by side: (..., 8 u, m) -> (..., u, 8 m).

    >>> import torch
    >>> unit_music(torch.zeros(2, 24, 35)).shape
    torch.Size([2, 3, 280])
    """
    return M.unflatten(-2, (-1, FRAMES)).flatten(-2)


def music_after(M: Tensor, known: int, seen: int) -> Tensor:
    """Of the last ``seen`` of so many ``known`` units, the music of the unit that follows each.

    Shapes: M (f, m), the whole song -> (seen, 8 m).
    """
    first = known - HISTORY - seen + 1
    return unit_music(music_window(M, FRAMES * first, FRAMES * seen))
