r"""Training windows: a few seconds of a dance and the music it was made for, a batch at a time.

Read first: notebook 03. All models learn from `WindowSampler`; a cut says what a window is to them.

Symbols (axes: b batch · w windows · n dancers · f frames · d motion, m music features · g genres)
    x       motion features, not normalised                            (n, f, d)
    M       music features of a window's song, raw                     (b, f, m)
    S       swap mode of a window of a group                           (b, n)
    genre   1 at the genre of the take, zeros where that is unknown    (b, g)
    energy  of the window's song, 0 to 1                               (b, f)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.data.augment import Augmentation, check_share
from dancediff.data.take import DanceTake
from dancediff.motion.order import left_to_right, swap_mode
from dancediff.motion.representation import LODGE, TCDIFFPP, MotionSpec, at_origin
from dancediff.music.energy import energy_curve


class Batch(NamedTuple):
    """Windows as a network learns from them; a single window has no axis b.

    >>> Batch(torch.zeros(4, 2, 150, 151), torch.zeros(4, 150, 35), torch.zeros(4, 2)).genre
    """

    x: Tensor  # (b, ..., f, d)
    M: Tensor  # (b, f, m)
    label: Tensor  # what the cut makes of it: S (b, n), or the number of a genre (b,)
    genre: Tensor | None = None  # (b, g)
    energy: Tensor | None = None  # (b, f)

    def to(self, device) -> "Batch":
        """The same windows on a device."""
        parts: Any = (  # from pinned memory the CPU need not wait
            None if part is None else part.to(device, non_blocking=part.is_pinned())
            for part in self
        )
        return Batch(*parts)


class Cut(Protocol):
    """What a window of a take is: how long, and which motion and label a model learns from it."""

    @property
    def num_frames(self) -> int:
        """Length of a window."""
        ...

    @property
    def spec(self) -> MotionSpec:
        """The motion vector of the window."""
        ...

    def __call__(self, take: DanceTake, start: int) -> Tensor:
        """The motion of the window at ``start``, before augmentation."""
        ...

    def finish(self, x: Tensor, take: DanceTake) -> tuple[Tensor, Tensor]:
        """The motion to learn and its label, after augmentation."""
        ...


@dataclass(frozen=True)
class GroupCut:
    """Windows of groups: x (n, f, 151), dancers from left to right, and label S (n,).

    Source: TCDiff++ section 4.4: 150 frames.

    >>> GroupCut(150).finish(torch.zeros(3, 150, 151), None)[1].tolist()
    [0, 1, 2]
    """

    num_frames: int = 150
    spec: MotionSpec = TCDIFFPP

    def __call__(self, take: DanceTake, start: int) -> Tensor:
        """A view."""
        return take.x[:, start : start + self.num_frames]

    def finish(self, x: Tensor, take: DanceTake) -> tuple[Tensor, Tensor]:
        """Ranked last: in the mirror, who stood left stands right."""
        return rank_left_to_right(x)


@dataclass(frozen=True)
class SoloCut:
    """Windows for Lodge's local stage: x (f, 139) that starts at x = z = 0, and a genre number.

    >>> SoloCut(64, ("hiphop", "salsa"))(DanceTake("solo", torch.ones(1, 90, 151)), 3).shape
    torch.Size([64, 139])
    """

    num_frames: int
    genres: tuple[str, ...]
    spec: MotionSpec = LODGE

    def __call__(self, take: DanceTake, start: int) -> Tensor:
        """A copy."""
        return at_origin(take.x[0, start : start + self.num_frames, : self.spec.dim])

    def finish(self, x: Tensor, take: DanceTake) -> tuple[Tensor, Tensor]:
        """The genre's number, as a tensor of no dimension."""
        return x, torch.tensor(self.genres.index(take.genre))


def rank_left_to_right(x: Tensor) -> tuple[Tensor, Tensor]:
    r"""Put dancers in left-to-right order of the first frame, and tell their order in the last.

    Source: TCDiff++ eq. 5 to 7, see `dancediff.motion.order`.

    Shapes: x (n, f, d) not normalised -> sorted x (n, f, d), S (n,).

    >>> x = torch.zeros(2, 2, 151)
    >>> x[:, :, 4] = torch.tensor([[1.0, 0.0], [0.0, 1.0]])        # two dancers change places
    >>> rank_left_to_right(x)[1].tolist()
    [1, 0]
    """
    first, last = x[:, 0, TCDIFFPP.lateral], x[:, -1, TCDIFFPP.lateral]
    return x[left_to_right(first)], swap_mode(first, last)


def half_overlapping(take: DanceTake, cut: Cut) -> tuple[Tensor, Tensor]:
    """All windows of a take, half a window apart, and their labels, for statistics.

    Shapes: -> x (w, ...), labels (w, ...).
    Raises: ValueError when the take is shorter than a window.

    >>> x, S = half_overlapping(DanceTake("duo", torch.zeros(2, 8, 151)), GroupCut(4))
    >>> x.shape, S.shape
    (torch.Size([3, 2, 4, 151]), torch.Size([3, 2]))
    """
    _check_long_enough([take], cut)
    f = cut.num_frames
    starts = range(0, take.num_frames - f + 1, max(1, f // 2))
    windows = [cut.finish(cut(take, start), take) for start in starts]
    motions, labels = (torch.stack(part) for part in zip(*windows, strict=True))
    return motions, labels


def _check_long_enough(takes: Sequence[DanceTake], cut: Cut) -> None:
    if short := [take.name for take in takes if take.num_frames < cut.num_frames]:
        longest = max(take.num_frames for take in takes)
        raise ValueError(
            f"takes shorter than num_frames={cut.num_frames}: {short[:5]}, the longest of all "
            f"{longest}; leave them out, or prepare takes of {cut.num_frames / FPS:.0f} s"
        )


def order_changes(takes: Sequence[DanceTake], num_frames: int, every: int = 5) -> list[np.ndarray]:
    """Windows in which dancers change their left-to-right order, one array for each new order.

    Looks at every ``every``-th start; an array has rows (number of the take, first frame).

    >>> x = torch.zeros(2, 8, 151)
    >>> x[:, :, 4] = torch.linspace(-1, 1, 8) * torch.tensor([[1.0], [-1.0]])
    >>> order_changes([DanceTake("crossing", x)], num_frames=6)[0].tolist()
    [[0, 0]]
    """
    found: dict[tuple[int, ...], list[tuple[int, int]]] = {}
    for k, take in enumerate(takes):
        lateral = take.x[:, :, TCDIFFPP.lateral].T
        starts = torch.arange(0, len(lateral) - num_frames + 1, every)
        orders = swap_mode(lateral[starts], lateral[starts + num_frames - 1]).tolist()
        for start, order in zip(starts.tolist(), orders, strict=True):
            if order != sorted(order):
                found.setdefault(tuple(order), []).append((k, start))
    return [np.array(found[order]) for order in sorted(found)]


class WindowSampler:
    """Random windows from takes, a batch at a time, all of one group size.

    The batch of a step depends on (seed, step) alone, so a run that resumes sees what it would have
    seen. ``dancers_per_batch`` keeps the work of a step the same for every group size.

    ``real``: share of windows from takes that people danced (real or composed), where a group size
    has both them and synthetic ones; by default every take counts the same.
    ``swaps``: share of windows, drawn from all takes of a group size, in which dancers change their
    left-to-right order, every order as often as any other. In a dance most windows keep their
    order, so by default few show how to change it.
    ``genres``: names in the order of `Batch.genre`; ``energy``: windows have that of their song.

    Raises: ValueError when a take has no music or is shorter than a window, or there is none.

    >>> takes = [DanceTake("duo", torch.zeros(2, 200, 151), M=torch.zeros(200, 35))]
    >>> x, M, S, *_ = WindowSampler(takes, GroupCut(150), dancers_per_batch=8).batch(0)
    >>> x.shape, M.shape, S.shape
    (torch.Size([4, 2, 150, 151]), torch.Size([4, 150, 35]), torch.Size([4, 2]))
    """

    def __init__(
        self,
        takes: Sequence[DanceTake],
        cut: Cut,
        *,
        genres: Sequence[str] = (),
        energy: bool = False,
        augment: Augmentation | None = None,
        dancers_per_batch: int = 24,
        real: float | None = None,
        swaps: float = 0.0,
        seed: int = 0,
    ):
        if not takes:
            raise ValueError("there are no takes at all to cut windows from; choreograph some")
        if mute := [take.name for take in takes if take.M is None]:
            raise ValueError(f"takes without music: {mute}; leave them out")
        _check_long_enough(takes, cut)
        if dancers_per_batch < 1:
            raise ValueError(f"dancers_per_batch={dancers_per_batch} must be at least 1")
        check_share("real", real or 0.0)
        check_share("swaps", swaps)
        self.takes, self.cut, self.augment = takes, cut, augment or Augmentation()
        self.dancers_per_batch, self.seed = dancers_per_batch, seed
        self.real, self.swaps = real, swaps
        self.genres, self.with_energy = tuple(genres), energy
        self._curves: dict[tuple[int, int], Tensor] = {}  # energy of songs that were met, whole
        self._danced: dict[tuple[int, bool], list[DanceTake]] = {}  # by group size and `real`
        self.synthetic = [take for take in takes if not take.real]
        self.by_size: dict[int, list[DanceTake]] = {}
        for take in takes:
            n = take.num_dancers
            self.by_size.setdefault(n, []).append(take)
            self._danced.setdefault((n, take.real), []).append(take)
        sizes = self.by_size if swaps else ()
        self.changes = {n: order_changes(self.by_size[n], cut.num_frames) for n in sizes}

    def batch(self, step: int) -> Batch:
        """The windows of a step, all of one group size."""
        rng = np.random.default_rng([self.seed, step])
        n = int(rng.choice(sorted(self.by_size)))
        windows = [self._draw(n, rng) for _ in range(max(1, self.dancers_per_batch // n))]
        parts: Any = [
            None if part[0] is None else torch.stack(part) for part in zip(*windows, strict=True)
        ]
        return Batch(*parts)

    def _draw(self, n: int, rng: np.random.Generator) -> Batch:
        """A window of n dancers, at random."""
        takes, orders = self.by_size[n], self.changes.get(n)
        if orders and rng.random() < self.swaps:
            places = orders[rng.integers(len(orders))]
            k, start = places[rng.integers(len(places))]
            return self.window(takes[k], rng, start=int(start))
        return self.window(self.choose(n, rng), rng)

    def choose(self, n: int, rng: np.random.Generator) -> DanceTake:
        """A take of n dancers at random, with the share of real ones that was asked for."""
        takes = self.by_size[n]
        if self.real is not None:
            takes = self._danced.get((n, bool(rng.random() < self.real)), takes)
        return takes[rng.integers(len(takes))]

    def window(self, take: DanceTake, rng: np.random.Generator, start: int | None = None) -> Batch:
        """One window of a take, by default at random."""
        f = self.cut.num_frames
        if start is None:
            start = int(rng.integers(take.num_frames - f + 1))
        x = self.augment.motion(self.cut(take, start), rng, self.cut.spec)
        heard, number = take, 0
        if self.augment.music:
            number = int(rng.integers(len(take.songs)))
        foreign = self.augment.any_song and take.real and self.synthetic
        if foreign and rng.random() < self.augment.any_song:
            heard, number = self.synthetic[int(rng.integers(len(self.synthetic)))], 0
            start = int(rng.integers(heard.num_frames - f + 1))
        x, label = self.cut.finish(x, take)
        part = slice(start, start + f)
        genre = self.genre(take) if self.genres else None
        energy = self.energy(heard, number)[part] if self.with_energy else None
        return Batch(x, heard.songs[number][part], label, genre, energy)

    def genre(self, take: DanceTake) -> Tensor:
        """1 at the genre of a take (g,); zeros where it is none of those known."""
        return torch.tensor([float(name == take.genre) for name in self.genres])

    def energy(self, take: DanceTake, number: int) -> Tensor:
        """Energy of one of a take's songs, beside the loud parts of the whole song (f,)."""
        song = take.songs[number]
        key = song.data_ptr(), len(song)  # dancers of one take share its songs
        if key not in self._curves:
            self._curves[key] = energy_curve(song, take.loudness if number == 0 else None)
        return self._curves[key]
