r"""Solos for Lodge's two stages: every dancer of every take alone, in windows.

Symbols (axes: b batch · f frames · w windows · d = 139 motion, m music features)
    x      motion, metres and 6-D rotations         (f, d)
    songs  music that fits a take's beats, raw      (songs, f, m)
    M      music of the windows                     (b, N, m)
    genre  numbers                                  (b,)
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from dancediff.data.packed import PackedTakes
from dancediff.data.take import DanceTake
from dancediff.motion.beats import motion_beats
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE, joints_of
from dancediff.papers.lodge.primitives import Layout, at_origin, primitives_of


@dataclass(frozen=True, eq=False)
class Solo:
    """One dancer of one take."""

    name: str
    x: Tensor
    songs: Tensor
    genre: str
    kind: str = "synthetic"
    period: int | None = None  # frames after which a repeated dance begins again

    @property
    def captured(self) -> bool:
        """Did somebody dance this?"""
        return self.kind != "synthetic"

    @cached_property
    def beats(self) -> np.ndarray:
        """Where the dancer comes to rest; frames."""
        return motion_beats(joints_of(self.x, LODGE))


def solos_of(takes: Iterable[DanceTake], genres: tuple[str, ...]) -> list[Solo]:
    """The dancers of takes that have music and one of the genres."""
    return [
        Solo(f"{take.name}-{k}", x, _songs(take), take.genre, take.kind)
        for take in takes
        if take.M is not None and take.genre in genres
        for k, x in enumerate(take.motion.features("lodge"))
    ]


def _songs(take: DanceTake) -> Tensor:
    return torch.cat([take.M[None], *([] if take.M_other is None else [take.M_other])])


def prepared_solos(folder, genres: tuple[str, ...], split: str = "train") -> list[Solo]:
    """The same from a prepared folder; dances stay on disk until they are asked for.

    Raises: ValueError when the folder is not prepared, or has no such take.
    """
    packed = PackedTakes(folder, split)
    solos = [
        Solo(f"{place.entry.name}-{n}", x, packed.music(k), place.entry.genre, place.entry.kind)
        for k, place in enumerate(packed.places)
        if place.entry.genre in genres
        for n, x in enumerate(packed.motion(k)[..., : LODGE.dim])
    ]
    if not solos:
        raise ValueError(
            f"{str(folder)!r} has no take in {split!r} with music and a genre of "
            f"{', '.join(genres)}; prepare more data or name its genres in the config"
        )
    return solos


def repeated(solo: Solo, num_frames: int) -> Solo:
    """A solo danced again and again to its music, so that a window of any phase fits.

    The dancer goes on from where the dance ended; the pose jumps there, and so does the music.

    >>> solo = Solo("short", torch.arange(300.0)[:, None] * torch.ones(139), torch.rand(1, 300, 35),
    ...             "indian", "real")
    >>> long = repeated(solo, 1024)
    >>> len(long.x), long.songs.shape[1], long.period, long.x[300, 4:7].tolist()
    (1500, 1500, 300, [299.0, 0.0, 299.0])
    """
    f = len(solo.x)
    times = -(-num_frames // f) + 1
    x = solo.x.repeat(times, 1)
    walked = (solo.x[-1, LODGE.root] - solo.x[0, LODGE.root]) * x.new_tensor([1.0, 0.0, 1.0])
    x[:, LODGE.root] += torch.arange(times).repeat_interleave(f)[:, None] * walked
    return replace(solo, x=x, songs=solo.songs.repeat(1, times, 1), period=f)


class SoloWindows:
    """Random windows of solos; ``batch(number)`` follows from (seed, number) alone.

    Every solo that is long enough counts the same. Each window's root starts at x = z = 0. With a
    ``layout`` a window becomes its primitives (the first stage): 13 x 8 frames or, with a stride,
    every ``stride``-th frame of it. A solo as long as a local segment is long enough for that: it
    is `repeated`. Left out, as it was at first, no Indian dance of ours was long enough, and the
    first stage had never met one when it was asked for one.

    ``mirror``: share of windows mirrored.  ``captured``: share of windows that people danced.
    ``music``: any of the songs that fit.  ``any_song``: share of captured windows that have the
    song of any choreographed dance. Songs that were made to fit a captured dance give it away, so
    that a model need not listen to the genre, and does not when the song says otherwise.

    Raises: ValueError when no solo is long enough, or a share is none.
    """

    def __init__(
        self,
        solos: list[Solo],
        genres: tuple[str, ...],
        *,
        num_frames: int,
        windows_per_batch: int = 16,
        layout: Layout | None = None,
        seed: int = 0,
        mirror: float = 0.0,
        captured: float | None = None,
        music: bool = False,
        any_song: float = 0.0,
    ):
        name, enough = "num_frames", num_frames
        if layout is not None:
            name, enough = "local_frames", layout.local_frames
        self.solos = [
            solo if len(solo.x) >= num_frames else repeated(solo, num_frames)
            for solo in solos
            if len(solo.x) >= enough
        ]
        if not self.solos:
            longest = max((len(solo.x) for solo in solos), default=0)
            raise ValueError(
                f"no solo has {name}={enough} frames, the longest {longest}; prepare "
                f"takes of at least {enough / 30:.0f} s"
            )
        shares = {"mirror": mirror, "captured": captured or 0.0, "any_song": any_song}
        for name, share in shares.items():
            if not 0 <= share <= 1:
                raise ValueError(f"{name}={share} is no share; choose 0 (never) to 1 (always)")
        if windows_per_batch < 1:
            raise ValueError(f"windows_per_batch={windows_per_batch} must be at least 1")
        self.genres, self.num_frames, self.layout = genres, num_frames, layout
        self.windows_per_batch, self.seed = windows_per_batch, seed
        self.mirror, self.captured, self.music = mirror, captured, music
        self.any_song = any_song
        self.choreographed = [solo for solo in self.solos if not solo.captured]

    def batch(self, number: int) -> tuple[Tensor, Tensor, Tensor]:
        """Motion (b, f, d) in metres, music (b, N, m) raw, genre (b,)."""
        rng = np.random.default_rng([self.seed, number])
        windows = [self.window(self.choose(rng), rng) for _ in range(self.windows_per_batch)]
        return tuple(torch.stack(part) for part in zip(*windows, strict=True))

    def choose(self, rng: np.random.Generator) -> Solo:
        """A solo at random, with the share of captured ones that was asked for."""
        solos = self.solos
        if self.captured is not None:
            want = rng.random() < self.captured
            solos = [solo for solo in solos if solo.captured == want] or solos
        return solos[int(rng.integers(len(solos)))]

    def window(self, solo: Solo, rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """A window of a solo, at random."""
        start = int(rng.integers(len(solo.x) - self.num_frames + 1))
        x = self.cut(solo, start)
        if self.mirror and rng.random() < self.mirror:
            x = mirror_features(x, LODGE)
        song = solo.songs[int(rng.integers(len(solo.songs))) if self.music else 0]
        foreign = self.any_song and solo.captured and self.choreographed
        if foreign and rng.random() < self.any_song:
            other = self.choreographed[int(rng.integers(len(self.choreographed)))]
            song, start = other.songs[0], int(rng.integers(len(other.x) - self.num_frames + 1))
        M = song[start : start + self.num_frames]
        return x, M.clone(), torch.tensor(self.genres.index(solo.genre))

    def cut(self, solo: Solo, start: int) -> Tensor:
        """What a stage learns to make of the window at ``start``; (f, d), a copy."""
        x = solo.x[start : start + self.num_frames]
        if self.layout is None:
            return at_origin(x)
        if self.layout.stride > 1:
            return at_origin(x[:: self.layout.stride])
        joins = range(0, len(solo.x), solo.period or len(solo.x))
        primitives, _ = primitives_of(
            x,
            solo.beats - start,  # found once, in the whole take
            joins=[join - start for join in joins if start < join < start + self.num_frames],
            layout=self.layout,
        )
        return primitives.flatten(0, 1)

    def pieces(self) -> Iterator[Tensor]:
        """All windows of each solo, every half window, and their mirror images; (w, f, d)."""
        for solo in self.solos:
            starts = range(0, len(solo.x) - self.num_frames + 1, max(1, self.num_frames // 2))
            x = torch.stack([self.cut(solo, start) for start in starts])
            yield torch.cat([x, mirror_features(x, LODGE)]) if self.mirror else x
