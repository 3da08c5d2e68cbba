"""Files appear whole or not at all, whatever stops a program while it writes."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

UNFINISHED = ".part."  # how names of files begin that are being written


@contextmanager
def atomic_write(path) -> Iterator[Path]:
    """A path beside ``path`` to write to; what stands there then becomes ``path``.

    It ends like ``path``, so that writers who look at the suffix see the right one. When the block
    raises, the old file, if there was one, stays as it was.

    Raises: OSError when the folder cannot be written.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with atomic_write(f"{folder}/words.txt") as part:
    ...         _ = part.write_text("whole")
    ...     [file.name for file in Path(folder).iterdir()]
    ['words.txt']
    """
    path = Path(path)
    part = path.with_name(f"{UNFINISHED}{os.getpid()}.{path.name}")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
