"""librosa, imported by one process at a time until numba has stored what it compiles.

For each function that librosa compiles when it is imported, numba writes two files, one after the
other. Processes that do so at the same time can leave two files that do not belong together; from
then on every import ends in a segmentation fault (numba issue 10128). So the first one holds a
lock, and those that come meanwhile wait and find everything compiled.
"""

import contextlib
import importlib.util
import os
import tempfile
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

COMPILED = ("librosa.beat", "librosa.core.audio", "librosa.core.pitch", "librosa.util.utils")


@cache
def import_librosa() -> ModuleType:
    """The package librosa; the first time on a machine it takes about 15 s.

    >>> import_librosa().note_to_hz("A4").item()
    440.0
    """
    mark = _mark()
    if not mark.exists():
        from filelock import FileLock

        with FileLock(mark.with_suffix(".lock")):
            for name in COMPILED:
                importlib.import_module(name)
            mark.touch()
    return importlib.import_module("librosa")


def _mark() -> Path:
    """An empty file that is there once this librosa is compiled for this processor."""
    from llvmlite.binding import get_host_cpu_name

    spec = importlib.util.find_spec("librosa")
    assert spec is not None and spec.origin is not None
    home = Path(spec.origin).parent / "__pycache__"
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or home)  # where numba writes, if it can
    with contextlib.suppress(OSError):  # made first: all processes must agree on the place
        folder.mkdir(parents=True, exist_ok=True)
    if not (folder.is_dir() and os.access(folder, os.W_OK)):
        folder = Path(tempfile.gettempdir())
    parts = (spec.origin, version("librosa"), version("numba"), get_host_cpu_name())
    digest = sha256(" ".join(parts).encode()).hexdigest()[:16]
    return folder / f"dancediff-compiled-{digest}.txt"
