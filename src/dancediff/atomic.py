"""Files appear whole or not at all, whatever stops a program while it writes.

Read first: docs/trust.md.
"""

import errno
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

RENAMED = {"spread": "std", "knobs": "scale_and_shift"}  # parts of tensors' names in older files
UNFINISHED = ".part."  # how names of files begin that are being written
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


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
    part = hidden(path)
    try:
        with writing(path):
            yield part
            part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all, and its folder where there is none.

    Raises: OSError when the folder cannot be written.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_text(Path(folder, "new", "words.txt"), "whole")
    ...     Path(folder, "new", "words.txt").read_text()
    'whole'
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")


def write_toml(path: Path, tables: dict[str, dict]) -> None:
    """Write tables of numbers, strings and lists, which TOML has in the form of JSON.

    Raises: OSError when the folder cannot be written.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_toml(Path(folder, "a.toml"), {"train": {"steps": 5, "precision": "fp32"}})
    ...     print(Path(folder, "a.toml").read_text(), end="")
    [train]
    steps = 5
    precision = "fp32"
    """
    lines = []
    for name, values in tables.items():
        written = {key: json.dumps(value, ensure_ascii=False) for key, value in values.items()}
        lines += [f"[{name}]", *(f"{key} = {value}" for key, value in written.items())]
    write_text(path, "\n".join(lines) + "\n")


def hidden(path: Path) -> Path:
    """Where this process writes what will be ``path``."""
    return path.with_name(f"{UNFINISHED}{os.getpid()}.{path.name}")


def sweep(folder) -> None:
    """Remove what killed programs left behind in a folder that nobody else writes to.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     hidden(Path(folder, "words.txt")).touch()
    ...     sweep(folder)
    ...     list(Path(folder).iterdir())
    []
    """
    for left in Path(folder).rglob(f"{UNFINISHED}*"):
        left.unlink(missing_ok=True)


@contextmanager
def writing(path) -> Iterator[None]:
    """Let errors of the disk say what was being written; a failed `write` does not by itself.

    >>> with writing("dance.npz"):
    ...     raise OSError(28, "No space left on device")
    Traceback (most recent call last):
    OSError: [Errno 28] No space left on device: 'dance.npz'
    """
    try:
        yield
    except OSError as err:
        if err.errno is not None and err.filename in (None, str(hidden(Path(path)))):
            with suppress(AttributeError):  # of some libraries' own errors it cannot be set
                err.filename = str(path)
        raise


def tensor_name(name: str) -> str:
    """The name that a tensor of a file has now.

    >>> tensor_name("film.knobs.1.weight")
    'film.scale_and_shift.1.weight'
    """
    return ".".join(RENAMED.get(part, part) for part in name.split("."))


def save_tensors(tensors: dict, path, metadata: dict[str, str] | None = None) -> None:
    """A safetensors file that appears whole or not at all.

    Raises: OSError when it cannot be written (safetensors has an error of its own for that).
    """
    from safetensors import SafetensorError
    from safetensors.torch import save_file

    with atomic_write(path) as part:
        part.touch()
        mode = part.stat().st_mode
        try:
            save_file(tensors, part, metadata)
        except SafetensorError as err:
            raise OSError(f"{path} cannot be written: {err}") from err
        part.chmod(mode)  # safetensors lets nobody else read it


def is_full(err: BaseException) -> bool:
    """Whether the disk takes no more: whatever was to be written is not to blame.

    >>> is_full(OSError(errno.ENOSPC, "No space left on device")), is_full(ValueError("odd"))
    (True, False)
    """
    return isinstance(err, OSError) and err.errno in FULL
