r"""Which dances are to be measured, and what their files say about them.

Read first: `dancediff.motion.files`, which finds files; then `dancediff.metrics.measure`.

Symbols
    beats   times of the music's beats, seconds   (k,)
"""

import contextlib
import json
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dancediff.arrays import COMPRESSED, read_arrays
from dancediff.data.take import KINDS, DanceTake
from dancediff.motion.files import files
from dancediff.motion.motion import Motion

Source = Path | Motion | DanceTake


def find_dances(sources) -> list[Source]:
    """Every dance that is meant, none twice.

    A source is a file, a folder or a prepared folder, see `dancediff.io.dance_files`, or a `Motion`
    or `DanceTake`, which stays as it is.

    Raises: ValueError naming a path that does not exist or holds no dance, or what is neither.

    >>> find_dances(["nowhere.npz"])
    Traceback (most recent call last):
        ...
    ValueError: 'nowhere.npz' does not exist; name a dance or a folder of dances
    """
    one = isinstance(sources, str | os.PathLike | Motion | DanceTake)
    found: dict = {}
    for source in [sources] if one else sources:
        if isinstance(source, Motion | DanceTake):
            found[id(source)] = source
        elif not isinstance(source, str | os.PathLike):
            kind = type(source).__name__
            raise ValueError(f"dances has a {kind}; give each a Motion, a DanceTake or a path")
        else:
            found |= {path.resolve(): path for path in files().find(source)}
    if not found:
        raise ValueError("there are no dances to evaluate: the list is empty")
    return list(found.values())


class Dance(NamedTuple):
    """A dance to measure. ``beats`` are None where its source has none."""

    name: str
    kind: str  # of a take; what a model made is "generated", what does not say is "unknown"
    motion: Motion
    beats: np.ndarray | None = None
    genre: str | None = None


def read_dance(source: Source, name: str = "dance") -> Dance:
    """Read a dance, and what its source says about it; ``name`` is for a `Motion` without one.

    Raises: ValueError or OSError when a file cannot be read.
    """
    if isinstance(source, DanceTake):
        return Dance(source.name, source.kind, source.motion, source.beats, source.genre)
    if isinstance(source, Motion):
        meta = source.meta
        return Dance(str(meta.get("name", name)), _kind(meta), source, genre=_genre(meta))
    motion = Motion.load(source)
    more: dict = {}
    if source.suffix.lower() == ".npz":
        more = read_arrays(source, ("take", "beats"), expand=COMPRESSED)
    kind, genre, beats = _kind(motion.meta), _genre(motion.meta), more.get("beats")
    if "take" in more:
        row = json.loads(str(more["take"]))
        kind, genre = (_kind(row), _genre(row)) if isinstance(row, dict) else (kind, genre)
    if beats is not None and beats.dtype.kind not in "fiu":
        raise ValueError(f"{str(source)!r}: beats holds {beats.dtype}, not times in seconds")
    # `dancediff generate` calls all its files "dance"; of many each has a folder of its own
    name = source.parent.name if source.stem == "dance" else source.stem
    return Dance(name, kind, motion, beats, genre)


def told_apart(names: list[str], paths: list[Path]) -> list[str]:
    """The names of files; those that two or more share become paths, without suffix if that does.

    >>> told_apart(["one", "one", "b"], [Path("one.npz"), Path("sub/one.npz"), Path("b.npz")])
    ['one', 'sub/one', 'b']
    """
    alike: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        alike.setdefault(name, []).append(k)
    found = list(names)
    for some in alike.values():
        if len(some) > 1:
            for k, name in zip(some, _relative([paths[k].absolute() for k in some]), strict=True):
                found[k] = name
    return found


def _relative(paths: list[Path]) -> list[str]:
    """Paths from where they part, without suffix unless two would be equal."""
    with contextlib.suppress(ValueError):  # on Windows, of several drives
        top = os.path.commonpath([path.parent for path in paths])
        paths = [path.relative_to(top) for path in paths]
    short = [
        path.parent if path.stem == "dance" and path.parent.name else path.with_suffix("")
        for path in paths
    ]
    return [path.as_posix() for path in (short if len({*short}) == len(short) else paths)]


def _kind(meta: dict) -> str:
    if meta.get("kind") in KINDS:
        return meta["kind"]
    if meta.get("synthetic"):
        return "synthetic"
    return "generated" if "model" in meta else "unknown"


def _genre(meta: dict) -> str | None:
    """One genre by its name; a mix is none of them."""
    return meta["genre"] if isinstance(meta.get("genre"), str) else None
