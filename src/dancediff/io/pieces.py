"""A dance that is written while it is made, for dances longer than memory."""

import contextlib
import shutil
import tempfile
import zipfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from dancediff.atomic import atomic_write
from dancediff.io.npz import check_finite, npz_arrays
from dancediff.motion.motion import Motion

_ALONG_TIME = ("rot6d", "root", "contact")  # (n, f, ...); the other arrays are those of one piece


def save_pieces(pieces: Iterable[Motion], path) -> Path:
    """Write the pieces of one dance, as `TCDiffPP.stream` hands them out, as one .npz.

    The file is the one that `Motion.save` writes of the whole dance; only one piece at a time is
    held in memory. It appears whole or not at all, its folder is made.

    Raises: ValueError when there is no piece, when the path does not end in .npz, when dancers or
    arrays differ between pieces, or numbers are not finite.

    >>> import torch
    >>> still = Motion(torch.eye(3).expand(2, 9, 24, 3, 3), torch.zeros(2, 9, 3))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = save_pieces([still, still], f"{folder}/dance.npz")
    ...     Motion.load(path).num_frames
    18
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise ValueError(f"path={str(path)!r} must end in .npz; pieces are written as nothing else")
    path.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(
            tempfile.TemporaryDirectory(prefix=".dancediff-", dir=path.parent)
        )
        files: dict = {}
        last, frames = None, 0
        for piece in pieces:
            check_finite(piece, path)
            last, arrays = piece, npz_arrays(piece)
            here = {
                (name, k)
                for name in _ALONG_TIME
                if name in arrays
                for k in range(piece.num_dancers)
            }
            if not files:
                for name, k in sorted(here):
                    new = Path(folder, f"{name}.{k}").open("w+b")
                    files[name, k] = stack.enter_context(new)
            if here != files.keys():
                raise ValueError(
                    f"a piece has {piece.num_dancers} dancers or other arrays than the first"
                )
            for (name, k), file in files.items():
                file.write(np.ascontiguousarray(arrays[name][k]).data)
            frames += piece.num_frames
        if last is None:
            raise ValueError("there is no piece; a dance has at least one")
        last = replace(last, meta=last.meta.get("whole", last.meta))  # those of a stream have both
        _join(path, npz_arrays(last), files, frames)
    return path


def _join(path: Path, arrays: dict[str, np.ndarray], files: dict, frames: int) -> None:
    """An .npz with the rows of the files in place of those of the last piece."""
    with atomic_write(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                if name not in _ALONG_TIME:
                    np.lib.format.write_array(member, array)
                    continue
                shape = (array.shape[0], frames, *array.shape[2:])
                facts = np.lib.format.header_data_from_array_1_0(array) | {"shape": shape}
                np.lib.format.write_array_header_1_0(member, facts)
                for k in range(len(array)):
                    files[name, k].seek(0)
                    shutil.copyfileobj(files[name, k], member, 1 << 20)
