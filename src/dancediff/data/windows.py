r"""Training windows: five seconds of a group dance and the music it was made for.

Symbols (axes: b batch · n dancers · f frames · d motion, m music features)
    x    motion features of a take, dancers in their own order   (n, f, d)
    M    music features of the take's song                       (f, m)
    x_0  a window, dancers from left to right                    (b, n, f, d)
    S    left-to-right order at the window's last frame          (b, n)
"""

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from itertools import chain
from math import prod
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from tqdm.auto import tqdm

from dancediff.data.augment import rotate_features, shift_features
from dancediff.data.choreographer import choreograph
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import TCDIFFPP
from dancediff.music.synth import synth_song

SIZES = (1, 2, 3, 4, 5)  # each song is danced once by a group of every size


@dataclass(frozen=True)
class Take:
    """One dance with its music; ``name`` says where it comes from, ``song`` what it is danced to.

    Takes to one song belong together: they share its beats, so a split must not part them.
    """

    name: str
    x: Tensor
    M: Tensor
    song: str = ""  # "" when no other take has this song
    others: Tensor | None = None  # features of other songs on the same beats (songs, f, m)
    kind: str = "synthetic"  # or "real", "composed"

    @property
    def captured(self) -> bool:
        """Did people dance this, together or not?"""
        return self.kind != "synthetic"

    @property
    def num_dancers(self) -> int:
        """Size of the group."""
        return self.x.shape[0]


def rank_left_to_right(x: Tensor) -> tuple[Tensor, Tensor]:
    r"""Put dancers in left-to-right order of the first frame, and tell their order in the last.

    Source: TCDiff++ eq. 5 to 7.  Differs: the released code sorts by the last frame and by depth,
    and then trains on the unsorted dancers.

    Shapes: x (n, f, d) not normalised -> sorted x (n, f, d), S (n,): S[k] is the rank at the first
    frame of the dancer who stands k-th from the left in the last frame.

    >>> x = torch.zeros(2, 2, 151)
    >>> x[:, :, 4] = torch.tensor([[1.0, 0.0], [0.0, 1.0]])        # two dancers change places
    >>> rank_left_to_right(x)[1].tolist()
    [1, 0]
    """
    lateral = TCDIFFPP.root.start
    x = x[x[:, 0, lateral].argsort(stable=True)]
    return x, x[:, -1, lateral].argsort(stable=True)


class GroupDanceWindows:
    """Random windows from takes, a batch at a time, all of one group size.

    ``dancers_per_batch`` keeps the work of a step the same for every group size. The batch of a
    step depends on (seed, step) alone, so a run that resumes sees what it would have seen.
    ``captured`` is the share of windows from takes that people danced (real or composed), where a
    group size has both them and synthetic ones; by default every take counts the same.

    Augmentation, off by default: ``mirror`` is the share of windows mirrored left to right,
    ``shift`` the largest offset of the whole group along x and along z, in metres, ``rotate`` the
    largest turn of the stage to either side, in radians; ``music`` also plays the other songs that
    fit a take's beats. Dancers are ranked after all that, as the audience then sees them.

    Raises: ValueError when a take is shorter than a window, or there is none.
    """

    def __init__(
        self,
        takes: list[Take],
        *,
        num_frames: int = 150,
        dancers_per_batch: int = 24,
        seed: int = 0,
        mirror: float = 0.0,
        shift: float = 0.0,
        rotate: float = 0.0,
        music: bool = False,
        captured: float | None = None,
    ):
        if not takes:
            raise ValueError("there are no takes at all to cut windows from; choreograph some")
        short = [take.name for take in takes if take.x.shape[1] < num_frames]
        if short:
            raise ValueError(f"takes shorter than {num_frames} frames: {short}; leave them out")
        if not 0 <= mirror <= 1:
            raise ValueError(f"mirror={mirror} is no share; choose 0 (never) to 1 (always)")
        if not 0 <= shift < float("inf"):
            raise ValueError(f"shift={shift} is no length; choose metres, 0 or more")
        if not 0 <= rotate <= np.pi:
            raise ValueError(f"rotate={rotate} is no angle; choose 0 to pi radians")
        if captured is not None and not 0 <= captured <= 1:
            raise ValueError(f"captured={captured} is no share; choose 0 (never) to 1 (always)")
        self.captured = captured
        self.num_frames, self.dancers_per_batch, self.seed = num_frames, dancers_per_batch, seed
        self.mirror, self.shift, self.rotate, self.music = mirror, shift, rotate, music
        self.by_size: dict[int, list[Take]] = {}
        for take in takes:
            self.by_size.setdefault(take.num_dancers, []).append(take)

    def batch(self, step: int) -> tuple[Tensor, Tensor, Tensor]:
        """Windows x_0 (b, n, f, d) and M (b, f, m), not normalised, and S (b, n)."""
        rng = np.random.default_rng([self.seed, step])
        n = int(rng.choice(sorted(self.by_size)))
        takes = self.by_size[n]
        windows = [
            self.window(self.choose(takes, rng), rng)
            for _ in range(max(1, self.dancers_per_batch // n))
        ]
        return tuple(torch.stack(part) for part in zip(*windows, strict=True))

    def choose(self, takes: list[Take], rng: np.random.Generator) -> Take:
        """A take at random, with the share of captured ones that was asked for."""
        if self.captured is not None:
            want = rng.random() < self.captured
            takes = [take for take in takes if take.captured == want] or takes
        return takes[rng.integers(len(takes))]

    def window(self, take: Take, rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """One random window of a take: x_0 (n, f, d), M (f, m), S (n,)."""
        start = int(rng.integers(take.x.shape[1] - self.num_frames + 1))
        part = slice(start, start + self.num_frames)
        # ranked last: in the mirror, who stood left stands right
        x_0, S = rank_left_to_right(self.augment(take.x[:, part], rng))
        M = take.M
        if self.music and take.others is not None and len(take.others):
            M = [take.M, *take.others][int(rng.integers(1 + len(take.others)))]
        return x_0, M[part], S

    def augment(self, x: Tensor, rng: np.random.Generator) -> Tensor:
        """Perhaps mirror, turn and shift a window (n, f, d); never changes ``x``."""
        if self.mirror and rng.random() < self.mirror:
            x = mirror_features(x)
        if self.rotate:
            x = rotate_features(x, rng.uniform(-self.rotate, self.rotate))
        if self.shift:
            x = shift_features(x, *rng.uniform(-self.shift, self.shift, 2))
        return x


def split_takes(
    takes: list[Take], *, share: float = 0.1, seed: int = 0
) -> tuple[list[Take], list[Take]]:
    """Training and validation takes; all takes to one song end up on one side.

    The side follows from (seed, song name) alone: a song stays where it is when others are added.
    ``share`` is the expected share of songs in validation; with few songs it may hold none.

    >>> takes = [Take(str(k), torch.zeros(1, 1, 151), torch.zeros(1, 35)) for k in range(100)]
    >>> [len(part) for part in split_takes(takes, share=0.2)]
    [83, 17]
    """
    if not 0 <= share < 1:
        raise ValueError(f"share={share} is out of range; choose 0 to below 1")
    parts: tuple[list[Take], list[Take]] = ([], [])
    for take in takes:
        digest = sha256(f"{seed}:{take.song or take.name}".encode()).digest()
        parts[int.from_bytes(digest[:8]) < share * 2**64].append(take)
    return parts


def choreographed_takes(song_seed: int, *, seconds: float = 30.0, sizes=SIZES) -> list[Take]:
    """One synthetic song, danced once by a group of every size; all of it follows from the seed.

    >>> [take.x.shape for take in choreographed_takes(0, seconds=6, sizes=(1, 3))]
    [torch.Size([1, 180, 151]), torch.Size([3, 180, 151])]
    """
    song, truth = synth_song(song_seed, seconds=seconds)
    M = song.features()
    takes = []
    for n in sizes:
        seed = 10 * song_seed + n
        dance, _ = choreograph(truth.beats, dancers=n, seed=seed, seconds=seconds)
        f = min(dance.num_frames, len(M))
        x = dance.features()[:, :f]
        takes.append(Take(f"choreographer-{seed}", x, M[:f].clone(), f"synth-{song_seed}"))
    return takes


def choreographed_corpus(
    song_seeds, *, seconds: float = 30.0, workers: int = 2, cache=None
) -> list[Take]:
    """Takes for many songs, made by several processes, in the order of the seeds.

    ``cache`` is a folder: songs found there are memory-mapped instead of made, the others are made
    and kept. A run that was stopped goes on with the song it had reached. A song takes about 8 MB
    for 30 s. float32, because float16 would move a planted foot by a millimetre or two.

    Raises: ValueError when the cache was made by another choreographer or with other ``seconds``.
    """
    seeds = list(song_seeds)
    cache = None if cache is None else Path(cache)
    ready: list[int] = []
    if cache is not None:
        cache.mkdir(parents=True, exist_ok=True)
        ready = [seed for seed in seeds if _is_cached(cache, seed)]
        if ready:
            _check_cache(cache, ready[0], seconds)
    todo = sorted(set(seeds) - set(ready))
    bar = partial(tqdm, total=len(todo), desc="choreographing", unit="song", disable=not todo)
    make = partial(_make_song, seconds=seconds, cache=cache)
    if workers < 2 or len(todo) < 2:
        made = dict(bar(map(make, todo)))
    else:
        context = get_context("spawn")
        with ProcessPoolExecutor(workers, context, torch.set_num_threads, (1,)) as pool:
            made = dict(bar(pool.map(make, todo)))
    songs = made if cache is None else {seed: _read_song(cache, seed) for seed in set(seeds)}
    return list(chain.from_iterable(_unpack_song(seed, *songs[seed]) for seed in seeds))


def _make_song(seed: int, seconds: float, cache: Path | None):
    """Make a song's takes, as plain arrays: all dancers of all sizes (15, f, d), and M (f, m)."""
    takes = choreographed_takes(seed, seconds=seconds)
    x, M = torch.cat([take.x for take in takes]).numpy(), takes[0].M.numpy()
    if cache is None:
        return seed, (x, M)
    for path, array in zip(_files(cache, seed), (x, M), strict=True):
        _write(path, array)
    return seed, None


def _unpack_song(seed: int, x, M) -> list[Take]:
    x, M = torch.as_tensor(x), torch.as_tensor(M)
    names = [f"choreographer-{10 * seed + n}" for n in SIZES]
    groups = zip(names, x.split(SIZES), strict=True)
    return [Take(name, group, M, f"synth-{seed}") for name, group in groups]


def _files(cache: Path, seed: int) -> tuple[Path, Path]:
    return cache / f"synth-{seed}.x.npy", cache / f"synth-{seed}.M.npy"


def _is_cached(cache: Path, seed: int) -> bool:
    return all(path.exists() for path in _files(cache, seed))


def _check_cache(cache: Path, seed: int, seconds: float) -> None:
    """Make one song again: a cache that outlived a change of the choreographer would mislead."""
    for old, new in zip(_read_song(cache, seed), _make_song(seed, seconds, None)[1], strict=True):
        fresh = torch.from_numpy(new)
        if old.shape != fresh.shape or not torch.allclose(old, fresh, rtol=1e-3, atol=1e-3):
            raise ValueError(
                f"cache {str(cache)!r} was made with other seconds than {seconds} or by another "
                "version of the choreographer; delete it or name another folder"
            )


def _write(path: Path, array: np.ndarray) -> None:
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with part.open("wb") as file:
            np.save(file, array, allow_pickle=False)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _read_song(cache: Path, seed: int) -> list[Tensor]:
    """Map a song's files. np.load would keep each one open, which ends at about 1000 of them."""
    arrays = []
    for path in _files(cache, seed):
        try:
            with path.open("rb") as file:
                np.lib.format.read_magic(file)
                shape, _, dtype = np.lib.format.read_array_header_1_0(file)
                skip = file.tell() // 4
            if dtype != np.float32:
                raise ValueError(f"it holds {dtype}")
            flat = torch.from_file(str(path), size=skip + prod(shape), dtype=torch.float32)
        except (ValueError, RuntimeError) as err:
            raise ValueError(f"{str(path)!r} is damaged; delete it to make it anew: {err}") from err
        arrays.append(flat[skip:].view(shape))
    return arrays
