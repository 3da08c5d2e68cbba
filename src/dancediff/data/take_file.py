r"""One take as one uncompressed .npz: a `Motion` file with music, beats and origin added.

The bytes follow from the take alone: no time stamps, no compression.

Symbols (axes: f frames · m music features)
    M        music features, raw                     (f, m)
    M_other  the same of other songs on its beats    (songs, f, m)
    take     origin of the take, as JSON text
"""

import json
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

from dancediff.arrays import read_arrays
from dancediff.atomic import writing
from dancediff.data.take import DanceTake
from dancediff.motion.motion import Motion
from dancediff.music.features import NUM_FEATURES

SCRATCH = ".part-"  # prefix of folders in which files are written before they are moved in place
_ORIGIN = ("name", "kind", "music", "genre", "split", "group", "source", "licence", "notes")
_UNREADABLE = (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError)


def describe(take: DanceTake, made_by: str = "") -> dict:
    """What an index says about a take; ``made_by`` names how it was made.

    Raises: ValueError or TypeError when ``notes`` are not plain JSON.
    """
    row = {name: getattr(take, name) for name in _ORIGIN}
    row |= {} if take.loudness is None else {"loudness": take.loudness}
    row |= {
        "dancers": take.motion.num_dancers,
        "frames": take.motion.num_frames,
        "fps": float(take.motion.fps),
        "songs": 0 if take.M is None else 1 + (0 if take.M_other is None else len(take.M_other)),
        "made_by": made_by,
    }
    return json.loads(json.dumps(row, allow_nan=False))


def write_take(path, take: DanceTake, made_by: str = "") -> Path:
    """Write a take; the file appears whole or not at all, and `Motion.load` reads it too."""
    path = Path(path)
    more = {"take": np.array(json.dumps(describe(take, made_by), sort_keys=True))}
    if take.M is not None:
        more["M"] = take.M.numpy().astype(np.float32)
    if take.M_other is not None:
        more["M_other"] = take.M_other.numpy().astype(np.float32)
    if take.beats is not None:
        more["beats"] = np.asarray(take.beats, dtype=np.float64)
    scratch = tempfile.TemporaryDirectory(prefix=SCRATCH, dir=path.parent.parent)
    with writing(path), scratch as folder:
        part = take.motion.save(Path(folder) / path.name)
        with zipfile.ZipFile(part, "a") as archive:
            for name, array in more.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                    np.lib.format.write_array(file, array, allow_pickle=False)
        return part.replace(path)


def read_row(path) -> dict:
    """What `describe` said about the take in a file, without reading the dance.

    Raises: ValueError naming the file when it is no prepared take.
    """
    path = Path(path)
    try:
        return _row(read_arrays(path, ("take",)))
    except _UNREADABLE as err:
        raise ValueError(f"{str(path)!r} is no prepared take; prepare it anew: {err}") from err


def read_take(path) -> DanceTake:
    """Read a take written by `write_take`.

    Raises: ValueError naming the file when it is damaged or no prepared take.
    """
    path = Path(path)
    try:
        arrays = read_arrays(path, ("take", "M", "M_other", "beats"))
        row = _row(arrays)
        del arrays["take"]
        for name, array in arrays.items():
            if array.dtype.kind != "f" or not np.isfinite(array).all():
                raise ValueError(f"{name} holds other than finite numbers")
        if "M" in arrays and arrays["M"].shape[1:] != (NUM_FEATURES,):
            raise ValueError(f"M has shape {arrays['M'].shape}, not (f, {NUM_FEATURES})")
        tensors: dict[str, Any] = {
            k: torch.from_numpy(v).float() for k, v in arrays.items() if k != "beats"
        }
        origin = {name: row[name] for name in _ORIGIN} | {"loudness": row.get("loudness")}
        return DanceTake(dance=Motion.load(path), beats=arrays.get("beats"), **tensors, **origin)
    except _UNREADABLE as err:
        raise ValueError(f"{str(path)!r} is no prepared take; prepare it anew: {err}") from err


def _row(data: dict) -> dict:
    if "take" not in data:
        raise ValueError("it does not say what it is")
    row = json.loads(str(data["take"]))
    if not isinstance(row, dict) or not set(_ORIGIN) <= set(row):
        raise ValueError("what it says about itself is incomplete")
    return row
