r"""Results that take long, kept in a folder under the hash of what they follow from.

Preparing data turns the cache on; everywhere else nothing is cached unless a folder is named.

Symbols (axes: f frames · m music features)
    M   music features, raw   (f, m)
"""

import contextlib
import hashlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dancediff.atomic import atomic_write
from dancediff.music.song import Music

_FOLDER: ContextVar[Path | None] = ContextVar("feature cache", default=None)
_PACKAGES = ("music", "motion", "data")


@contextlib.contextmanager
def use_cache(folder) -> Iterator[None]:
    """Keep what `cached` makes in this block in ``folder``; None turns the cache off."""
    token = _FOLDER.set(None if folder is None else Path(folder))
    try:
        yield
    finally:
        _FOLDER.reset(token)


@lru_cache(maxsize=8)
def code_digest(packages: tuple[str, ...] = _PACKAGES) -> str:
    """Hash of our own source in these packages: what an older version made is not taken for new."""
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for package in packages:
        for path in sorted(p for end in ("py", "toml") for p in (root / package).rglob(f"*.{end}")):
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def content_key(*parts) -> str:
    """A file name for whatever follows from these arrays, bytes, texts and numbers.

    >>> content_key("a", 1) == content_key("a", 1), content_key("a", 1) == content_key("a", 2)
    (True, False)
    """
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            head = f"{part.dtype}{part.shape}"
            data: memoryview | bytes = np.ascontiguousarray(part).data
        else:
            head = type(part).__name__
            data = part if isinstance(part, bytes) else repr(part).encode()
        # lengths keep ("ab", "c") and ("a", "bc") apart
        digest.update(f"{head}:{len(data)}:".encode())
        digest.update(data)
    return digest.hexdigest()[:32]


def cached(key: str, make: Callable[[], np.ndarray]) -> np.ndarray:
    """The array kept under ``key``, or a new one from ``make``, which is then kept.

    A damaged file is made anew. Several processes may share a folder.
    """
    folder = _FOLDER.get()
    if folder is None:
        return make()
    path = folder / f"{key}.npy"
    try:
        return np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError, SyntaxError, MemoryError):
        pass  # not there, or cut short
    array = make()
    with contextlib.suppress(OSError):  # a full disk is not this array's fault
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as part, part.open("wb") as file:
            np.save(file, array, allow_pickle=False)
    return array


def song_features(song: Music) -> Tensor:
    """The 35 features of a song, (f, m), from the cache if the same sound was there before.

    The same sound under another name is found; the same name with another sound is not.

    >>> song_features(Music(np.zeros(22050, dtype=np.float32), 22050)).shape
    torch.Size([31, 35])
    """
    sound = song.audio if isinstance(song.audio, np.ndarray) else song.audio.digest()
    key = content_key("features", code_digest(("music",)), sound, song.rate)
    return torch.from_numpy(cached(key, lambda: song.features().numpy()))
