"""Arrays in .npz files, read without trust in what the files promise."""

import io
import math
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np

COMPRESSED = 2**28  # bytes that a stranger's compressed .npz may become
_BROKEN = (
    OSError, zipfile.BadZipFile, zlib.error, EOFError, SyntaxError, RuntimeError, struct.error,
)  # fmt: skip


def read_arrays(path, names: tuple[str, ...] = (), *, expand: int = 0) -> dict[str, np.ndarray]:
    """The arrays of an .npz, all or those with the ``names`` that are there.

    No memory is taken for more than the file holds, whatever its headers promise; for more than
    ``expand`` bytes if its arrays are compressed.

    Raises: FileNotFoundError, or ValueError telling what is broken.
    """
    path = Path(path)
    size = path.stat().st_size
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            kinds = {m.compress_type for m in members} - {zipfile.ZIP_STORED}
            known = {zipfile.ZIP_DEFLATED} if expand else set()
            total = sum(max(m.file_size, m.compress_size) for m in members)
            if kinds - known or total > (max(size, expand) if kinds else size):
                raise ValueError("its arrays are compressed, or larger than the file itself")
            named = {m.filename.removesuffix(".npy"): m for m in members}
            keys = [name for name in named if name in names] if names else named
            return {name: _array(archive.read(named[name])) for name in keys}
    except _BROKEN as err:
        # a broken zip may even ask for a place before the file's first byte (OSError)
        raise ValueError(f"{type(err).__name__}: {err}") from err


def array_names(path) -> list[str]:
    """The names of the arrays in an .npz that `read_arrays` has read."""
    with zipfile.ZipFile(path) as archive:
        return [name.removesuffix(".npy") for name in archive.namelist()]


def read_array(path) -> np.ndarray:
    """The array of an .npy; no memory is taken for more than the file holds.

    Raises: FileNotFoundError, or ValueError telling what is broken.
    """
    content = Path(path).read_bytes()
    try:
        return _array(content)
    except _BROKEN as err:
        raise ValueError(f"it cannot be read as an array ({type(err).__name__}: {err})") from err


def _array(content: bytes) -> np.ndarray:
    """An array from the bytes of an .npy file."""
    file = io.BytesIO(content)
    if np.lib.format.read_magic(file) != (1, 0):
        raise ValueError("it has an array of another version than 1.0")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(content) - file.tell():
        raise ValueError(f"it has an array {shape} of {dtype} that does not fill its place")
    flat = np.frombuffer(bytearray(content), dtype, offset=file.tell())
    return flat.reshape(shape, order="F" if fortran else "C")
