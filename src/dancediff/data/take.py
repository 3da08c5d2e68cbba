r"""`DanceTake`: one dance as every reader hands it over, with what must be known about its origin.

Symbols (axes: n dancers · f frames · m music features)
    M        music features, raw                     (f, m)
    M_other  the same of other songs on its beats    (songs, f, m)
    beats    of the music                            seconds
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from torch import Tensor

from dancediff.motion.motion import Motion

KINDS = ("real", "composed", "synthetic")  # of the motion
MUSICS = ("original", "beat-aligned synthetic", "synthetic", "none")
SPLITS = ("train", "val", "test")


@dataclass(frozen=True)
class DanceTake:
    """A dance, its music, and where both come from.

    ``group`` names what must stay on one side of a split: takes that share a song, or the real
    motion that a composed take was made from; if there are two, their names joined by " + ".

    Raises: ValueError naming the field and what is allowed.
    """

    name: str
    motion: Motion
    kind: str
    music: str
    source: str
    licence: str
    split: str
    group: str
    M: Tensor | None = None
    M_other: Tensor | None = None
    beats: np.ndarray | None = None
    genre: str | None = None
    notes: dict = field(default_factory=dict)  # plain JSON: repaired spikes, measured numbers

    def __post_init__(self):
        for name, allowed in (("kind", KINDS), ("music", MUSICS), ("split", SPLITS)):
            value = getattr(self, name)
            if value not in allowed:
                raise ValueError(f"{name}={value!r} is not one of {', '.join(allowed)}")
        if self.M is not None and len(self.M) != self.motion.num_frames:
            raise ValueError(
                f"M has {len(self.M)} frames, the motion {self.motion.num_frames}; cut the longer"
            )
        if self.M_other is not None and (
            self.M is None or self.M_other.ndim != 3 or self.M_other.shape[1:] != self.M.shape
        ):
            raise ValueError(
                f"M_other has shape {tuple(self.M_other.shape)}; expected (songs, f, m) beside an M"
            )


@dataclass(frozen=True)
class Job:
    """A take that can be made: ``make`` must be picklable (a module's function, or a partial)."""

    name: str
    make: Callable[[], DanceTake]
