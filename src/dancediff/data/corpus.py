"""A training set without a folder: synthetic songs, each danced by a group of every size."""

from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import chain
from math import prod
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from tqdm.auto import tqdm

from dancediff.atomic import atomic_write
from dancediff.data.choreographer import choreograph
from dancediff.data.windows import Take
from dancediff.music.synth import synth_song

SIZES = (1, 2, 3, 4, 5)  # each song is danced once by a group of every size


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
    with atomic_write(path) as part, part.open("wb") as file:
        np.save(file, array, allow_pickle=False)


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
