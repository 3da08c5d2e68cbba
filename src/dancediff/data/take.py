r"""`DanceTake`: a dance and its music, as readers hand it over and as training learns from it.

Read first: `dancediff.motion.motion` · `dancediff.music.features`.

Symbols (axes: n dancers · f frames · d motion, m music features)
    x        motion vectors, not normalised          (n, f, d)
    M        music features, raw                     (f, m)
    M_other  the same of other songs on its beats    (songs, f, m)
    beats    of the music                            seconds
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from torch import Tensor

from dancediff.axes import FPS
from dancediff.motion.beats import kinematic_energy, motion_beats
from dancediff.motion.motion import Motion
from dancediff.motion.representation import TCDIFFPP, joints_of

KINDS = ("real", "composed", "synthetic")  # of the motion, from people to none
NO_MUSIC = "none"  # among `MUSICS`, what a dance was made to
MUSICS = ("original", "recorded", "beat-aligned synthetic", "synthetic", NO_MUSIC)
SPLITS = ("train", "val", "test")


def check_words(take) -> None:
    """Refuse a take, or an entry of an index, of another kind, music or split.

    Raises: ValueError naming the field and what is allowed.
    """
    for name, allowed in (("kind", KINDS), ("music", MUSICS), ("split", SPLITS)):
        value = getattr(take, name)
        if value not in allowed:
            raise ValueError(f"{name}={value!r} is not one of {', '.join(allowed)}")


@dataclass(frozen=True, eq=False)
class DanceTake:
    """A dance, its music, and where both come from.

    ``dance`` is a `Motion` or its motion vectors (n, f, 151), perhaps on disk; ``take.motion`` and
    ``take.x`` are the one made from the other when asked for. ``group`` names what must stay on one
    side of a split: takes that share a song, or the real motion that a composed take was made from;
    if there are two, their names joined by " + ".

    Raises: ValueError naming the field and what is allowed.

    >>> import torch
    >>> take = DanceTake("still", torch.zeros(2, 90, 151))
    >>> take.num_dancers, take.num_frames, take.motion.duration
    (2, 90, 3.0)
    """

    name: str
    dance: Motion | Tensor = field(repr=False)
    kind: str = "synthetic"
    music: str = "synthetic"
    source: str = ""
    licence: str = ""
    split: str = "train"
    group: str = ""
    M: Tensor | None = field(default=None, repr=False)
    M_other: Tensor | None = field(default=None, repr=False)
    beats: np.ndarray | None = field(default=None, repr=False)
    genre: str | None = None
    loudness: float | None = None  # dB, of the whole song where M is a part; see `song_loudness`
    period: int | None = None  # frames after which a repeated dance begins again
    notes: dict = field(default_factory=dict)  # plain JSON: repaired spikes, measured numbers

    def __post_init__(self):
        check_words(self)
        if self.M is not None and len(self.M) != self.num_frames:
            raise ValueError(
                f"M has {len(self.M)} frames, the motion {self.num_frames}; cut the longer"
            )
        if self.M_other is not None and (
            self.M is None or self.M_other.ndim != 3 or self.M_other.shape[1:] != self.M.shape
        ):
            raise ValueError(
                f"M_other has shape {tuple(self.M_other.shape)}; expected (songs, f, m) beside an M"
            )

    @cached_property
    def motion(self) -> Motion:
        """The dance as rotations and paths."""
        if isinstance(self.dance, Motion):
            return self.dance
        return Motion.from_features(self.dance, fps=FPS)

    @cached_property
    def x(self) -> Tensor:
        """The dance as motion vectors of TCDiff++; Lodge's are the first 139 numbers."""
        return self.dance.features() if isinstance(self.dance, Motion) else self.dance

    @property
    def num_dancers(self) -> int:
        """Size of the group."""
        moves = self.dance
        return moves.num_dancers if isinstance(moves, Motion) else moves.shape[0]

    @property
    def num_frames(self) -> int:
        """Length in frames."""
        moves = self.dance
        return moves.num_frames if isinstance(moves, Motion) else moves.shape[1]

    @property
    def real(self) -> bool:
        """Did people dance this, together or not?"""
        return self.kind != "synthetic"

    @property
    def songs(self) -> list[Tensor]:
        """Features of all songs that fit the dance's beats, its own first, each (f, m)."""
        return [] if self.M is None else [self.M, *(() if self.M_other is None else self.M_other)]

    @cached_property
    def motion_beats(self) -> np.ndarray:
        """Frames in which the whole group comes to rest."""
        return motion_beats(joints_of(self.x).transpose(0, 1).flatten(1, 2))

    @cached_property
    def kinematic_energy(self) -> np.ndarray:
        """How much the dancers move around each frame, (f,)."""
        return kinematic_energy(joints_of(self.x).transpose(0, 1).flatten(1, 2), fps=FPS)

    def solos(self, *, centred: bool = False) -> list["DanceTake"]:
        r"""Every dancer as a take of one; ``centred``: with the mean place at the origin.

        $$p_f \leftarrow p_f - \overline{p}, \quad \text{x and z only}$$

        Without it a model of one dancer would have to guess from the music where in a formation
        somebody stood.

        >>> import torch
        >>> trio = DanceTake("trio", torch.ones(3, 9, 151))
        >>> solos = trio.solos(centred=True)
        >>> [solo.name for solo in solos], solos[0].x[0, 0, 4:7].tolist()
        (['trio-0', 'trio-1', 'trio-2'], [0.0, 1.0, 0.0])
        """
        x = self.x
        if centred:
            x = x.clone()
            x[..., TCDIFFPP.floor] -= self.x[..., TCDIFFPP.floor].mean(1, keepdim=True)
        return [replace(self, name=f"{self.name}-{k}", dance=row[None]) for k, row in enumerate(x)]


@dataclass(frozen=True)
class Job:
    """A take that can be made: ``make`` must be picklable (a module's function, or a partial)."""

    name: str
    make: Callable[[], DanceTake]
