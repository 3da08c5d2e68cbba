r"""A group that dances Lodge's solo: in unison, one after the other, or as in a mirror.

Read first: `dancediff.generation.lodge_dance` · `dancediff.data.choreographer.formations`.

Lodge makes one dancer. Here the others repeat that dance, each from a place of a formation; no
dancer depends on another. A model of groups is `dancediff.papers.tcdiffpp`.

Symbols (axes: n dancers · F frames · f frames of a piece · d motion features)
    x        the solo, metres and 6-D rotations           (F, d)
    slots    places on the stage floor, left to right     (n, 2)   x lateral, z depth
    delay    frames by which each dancer is late          (n,)
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dancediff.axes import ON_FLOOR
from dancediff.data.choreographer.formations import MIN_DISTANCE, formation_names, slots
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE, at_origin

MAX_DANCERS = 5  # for whom there are formations
RELATIONS = ("unison", "canon", "mirror")
EASE = 8  # frames before and after a late start in which a dancer gets going
CANON_BEATS = 4  # between one dancer's start and the next one's
WITHOUT_BEATS = 60  # frames; four beats at 120 a minute
WIDEST = 3.0  # times the formation's size
PIECE = 1800  # frames that are looked at together: a minute


def places(dancers: int, formation: str) -> np.ndarray:
    """Where the dancers begin, left to right, (n, 2) metres; one dancer alone has the middle.

    Raises: ValueError naming the formations there are.

    >>> places(2, "line").tolist()
    [[-0.7, 0.0], [0.7, 0.0]]
    """
    if dancers == 1 and formation == "line":
        formation = "centre"
    if formation not in formation_names(dancers):
        known = ", ".join(map(repr, formation_names(dancers)))
        raise ValueError(f"formation={formation!r} is none of {dancers} dancers'; choose {known}")
    return slots(dancers, formation)


def canon_delays(dancers: int, beats: np.ndarray) -> list[int]:
    """How late each dancer starts: 4 of the song's median beats after its left neighbour.

    >>> canon_delays(3, np.arange(0, 300, 15)), canon_delays(2, np.array([]))
    ([0, 60, 120], [0, 60])
    """
    each = WITHOUT_BEATS
    if len(beats) > 1:
        each = round(CANON_BEATS * float(np.median(np.diff(beats))))
    return [k * each for k in range(dancers)]


@dataclass(eq=False)
class Group:
    """Copies of a solo on their places, made for as many frames at a time as are asked for.

    "unison": all the same. "canon": each ``delay`` frames later, in the first pose until then and
    slowly out of it. "mirror": dancers on the right are the mirror images of those on the left.

    A solo that travels may bring copies closer than the 0.75 m at which the choreographer keeps its
    dancers, where they do not travel alike; the formation is then made wider, up to three times.

    Shapes: x (F, d), slots (n, 2), delay (n,).
    Raises: ValueError for another relation.

    >>> group = Group(torch.zeros(30, 139), np.array([[-1.0, 0.0], [1.0, 0.5]]), "unison")
    >>> group.frames(20, 30).shape, group.frames(0, 1)[:, 0, 4:7].tolist()
    (torch.Size([2, 10, 139]), [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.5]])
    """

    x: Tensor
    slots: np.ndarray
    relation: str
    delay: Sequence[int] = ()  # only of a canon

    def __post_init__(self):
        if self.relation not in RELATIONS:
            known = ", ".join(map(repr, RELATIONS))
            raise ValueError(f"relation={self.relation!r} is not one of {known}")
        self.x = at_origin(self.x)
        self.home = torch.zeros(len(self.slots), 1, 3, dtype=self.x.dtype)
        self.home[:, 0, ON_FLOOR] = torch.from_numpy(self.slots).to(self.x)
        if len(self.slots) > 1:
            self.home *= _wide_enough(self._paths(), self.home)

    def frames(self, start: int, stop: int) -> Tensor:
        """Some frames of all dancers, (n, f, d)."""
        y = self._unplaced(start, stop)
        y[..., LODGE.root] += self.home
        return y

    def _unplaced(self, start: int, stop: int) -> Tensor:
        """As if all began in the middle of the stage."""
        n, part = len(self.slots), slice(start, stop)
        if self.relation == "canon":
            delays = zip(self.slots, self.delay, strict=True)
            return torch.stack([late(self.x, frames, part=part) for _, frames in delays])
        y = self.x[part].expand(n, -1, -1).clone()
        if self.relation == "mirror":
            right = torch.from_numpy(self.slots[:, 0] > 0)
            y[right] = mirror_features(y[right], LODGE)
        return y

    def _paths(self) -> Tensor:
        """Where all would go from the middle of the stage, (n, F, 3)."""
        starts = range(0, len(self.x), PIECE)
        pieces = (self._unplaced(start, start + PIECE) for start in starts)
        return torch.cat([piece[..., LODGE.root].clone() for piece in pieces], dim=1)


def late(x: Tensor, frames: int, *, ease: int = EASE, part: slice = slice(None)) -> Tensor:
    r"""Start later, and end before the dance does.

    $$\tau = \begin{cases} 0 & i \le -E \\ (i + E)^2 / 4E & -E < i < E \\ i & i \ge E \end{cases}$$

    At i frames after its turn a dancer is where the first one was in frame tau: it starts E =
    ``ease`` frames early and slowly, and is exactly ``frames`` late from E frames after on. Feet
    step where the first dancer's did. ``part``: only these frames of the result.

    Shapes: (F, d) -> (F, d), or (f, d) for f frames of it.

    >>> late(torch.arange(8.0)[:, None], 4, ease=2).flatten().tolist()
    [0.0, 0.0, 0.0, 0.125, 0.5, 1.125, 2.0, 3.0]
    """
    frames = min(frames, len(x) - 1)
    ease = min(ease, frames)
    i = torch.arange(len(x), dtype=torch.float64)[part] - frames
    if ease:
        i = torch.where(i < ease, (i + ease).clamp_min(0) ** 2 / (4 * ease), i)
    tau = i.clamp_min(0)
    before = tau.floor().long()
    after, w = (before + 1).clamp_max(len(x) - 1), (tau - before).to(x)[:, None]
    return x[before] * (1 - w) + x[after] * w


def _wide_enough(path: Tensor, home: Tensor) -> float:
    """The smallest factor, in quarters, that keeps all pairs apart; paths (n, F, 3)."""
    for factor in np.arange(1, WIDEST + 0.01, 0.25):
        if nearest(path + factor * home) >= MIN_DISTANCE:
            break
    return float(factor)


def nearest(path: Tensor) -> float:
    """The smallest distance of two dancers on the floor, (n, F, 3) -> metres; inf for a solo.

    >>> nearest(torch.tensor([[[0.0, 1.0, 0.0]], [[3.0, 0.0, 4.0]]]))
    5.0
    """
    if len(path) < 2:
        return float("inf")
    floor = path[..., ON_FLOOR].transpose(0, 1)
    i, j = torch.triu_indices(len(path), len(path), 1)
    return float((floor[:, i] - floor[:, j]).norm(dim=-1).min())
