r"""Solos for Lodge's two stages, and the primitives that the first one learns.

Read first: `dancediff.papers.lodge.primitives` · `dancediff.data.windows`.

Symbols (axes: f frames · w windows · d = 139 motion features)
    x      motion, metres and 6-D rotations   (f, d)
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.data.choreographed import choreographed_corpus
from dancediff.data.choreographer import GENRES
from dancediff.data.packed import PackedTakes
from dancediff.data.take import DanceTake
from dancediff.data.windows import SoloCut, WindowSampler, half_overlapping
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE, MotionSpec, at_origin
from dancediff.papers.lodge.primitives import Layout, primitives_of
from dancediff.training.group_takes import tell_other_genres


def solos_of(takes: Iterable[DanceTake], genres: tuple[str, ...]) -> list[DanceTake]:
    """The dancers of takes that have music and one of the genres."""
    return [
        solo
        for take in takes
        if take.M is not None and take.genre in genres
        for solo in take.solos()
    ]


def prepared_solos(folder, genres: tuple[str, ...], split: str = "train") -> list[DanceTake]:
    """The same from a prepared folder; dances stay on disk until they are asked for.

    Raises: ValueError when the folder is not prepared, or has no such take.
    """
    takes = PackedTakes(folder, split).takes()
    solos = solos_of(takes, genres)
    if not solos:
        raise ValueError(
            f"{str(folder)!r} has no take in {split!r} with music and a genre of "
            f"{', '.join(genres)}; prepare more data or name its genres in the config"
        )
    if split == "train":
        tell_other_genres(takes, genres, "left out")
    return solos


def choreographed_solos(song_seeds, seconds: float, genres: tuple[str, ...], **options):
    """Solos of `choreographed_corpus`, of these genres.

    Raises: ValueError when the choreographer knows none of them, or no song was danced in one.
    """
    named = ", ".join(genres)
    if not set(genres) & set(GENRES):
        raise ValueError(
            f"the choreographer dances none of the genres {named}; name some of "
            f"{', '.join(GENRES)} in the config, or give a prepared folder (--data)"
        )
    takes = choreographed_corpus(song_seeds, seconds=seconds, sizes=(1,), **options)
    solos = solos_of(takes, genres)
    if not solos:
        raise ValueError(
            f"none of the choreographer's {len(takes)} solos has one of the genres {named}; "
            "make more songs, or name more genres in the config"
        )
    return solos


@dataclass(frozen=True)
class PrimitiveCut:
    """Windows for Lodge's global stage: primitives (104, 139) of a global segment, a genre number.

    With a ``stride`` in the layout, every ``stride``-th frame of the segment instead.
    """

    layout: Layout
    genres: tuple[str, ...]
    spec: MotionSpec = LODGE

    @property
    def num_frames(self) -> int:
        """Frames of a global segment."""
        return self.layout.global_frames

    def __call__(self, take: DanceTake, start: int) -> Tensor:
        """A copy; beats and energy are found once, in the whole take."""
        x = take.x[0, start : start + self.num_frames, : self.spec.dim]
        if self.layout.stride > 1:
            return at_origin(x[:: self.layout.stride])
        joins = range(0, take.num_frames, take.period or take.num_frames)
        primitives, _ = primitives_of(
            x,
            take.motion_beats - start,
            energy=take.kinematic_energy[start : start + self.num_frames],
            joins=[join - start for join in joins if start < join < start + self.num_frames],
            layout=self.layout,
        )
        return primitives.flatten(0, 1)

    finish = SoloCut.finish


def long_enough(solos: Sequence[DanceTake], cut: SoloCut | PrimitiveCut) -> list[DanceTake]:
    """Solos from which windows can be cut.

    For primitives a solo as long as a local segment will do: it is `repeated`. Left out, as it was
    at first, no Indian dance was long enough, and the global stage never met that genre.

    Raises: ValueError when there is none.
    """
    name, least = "num_frames", cut.num_frames
    if isinstance(cut, PrimitiveCut):
        name, least = "local_frames", cut.layout.local_frames
    kept = [repeated(solo, cut.num_frames) for solo in solos if solo.num_frames >= least]
    if not kept:
        longest = max((solo.num_frames for solo in solos), default=0)
        raise ValueError(
            f"no solo has {name}={least} frames, the longest {longest}; prepare "
            f"takes of at least {least / FPS:.0f} s"
        )
    return kept


def repeated(solo: DanceTake, num_frames: int) -> DanceTake:
    """A solo danced again and again to its music, where it is shorter than ``num_frames``.

    It becomes so long that a window of any phase fits. The dancer goes on from where the dance
    ended; the pose jumps there, and so does the music.

    >>> x = torch.arange(300.0)[:, None] * torch.ones(1, 1, 151)
    >>> long = repeated(DanceTake("short", x, M=torch.rand(300, 35)), 1024)
    >>> long.num_frames, len(long.M), long.period, long.x[0, 300, 4:7].tolist()
    (1500, 1500, 300, [299.0, 0.0, 299.0])
    """
    f = solo.num_frames
    if f >= num_frames:
        return solo
    times = -(-num_frames // f) + 1
    x = solo.x.repeat(1, times, 1)
    walked = solo.x[0, -1, LODGE.floor] - solo.x[0, 0, LODGE.floor]
    x[0, :, LODGE.floor] += torch.arange(times).repeat_interleave(f)[:, None] * walked
    other = None if solo.M_other is None else solo.M_other.repeat(1, times, 1)
    M = None if solo.M is None else solo.M.repeat(times, 1)
    return replace(solo, dance=x, M=M, M_other=other, period=f)


def half_windows(windows: WindowSampler) -> Iterator[Tensor]:
    """All windows of each solo, half a window apart, and their mirror images; (w, f, d)."""
    for solo in windows.takes:
        x, _ = half_overlapping(solo, windows.cut)
        yield torch.cat([x, mirror_features(x, LODGE)]) if windows.augment.mirror else x
