"""What `Motion.save`, `Motion.load` and a notebook's picture of a dance call.

A motion is data and geometry. What writes, reads and draws it stands above it and imports it, so it
must not import them, not even inside a function. `dancediff.io` hands its functions over here.
That it is there when they are needed is up to `dancediff.import_io`, of the package's first module:
Python runs that one before any other, and it may name every module.
"""

from collections.abc import Callable
from dataclasses import dataclass

import dancediff


@dataclass(frozen=True)
class Files:
    """The functions behind the methods of `Motion`, and the one that finds files of dances."""

    save: Callable
    load: Callable
    picture: Callable
    find: Callable


_registered: list[Files] = []


def register(files: Files) -> None:
    """Use these functions from now on."""
    _registered[:] = [files]


def files() -> Files:
    """The functions that were registered.

    >>> files().save.__module__
    'dancediff.io'
    """
    if not _registered:
        dancediff.import_io()
    return _registered[0]
