r"""Dances in a .npy: a vector a frame, as other papers' code writes it, or joint positions.

    (f, 139)            Lodge: contacts, root path, 22 rotations of 6 numbers
    (f, 151)            EDGE, TCDiff: the same with 24 rotations
    (f, 315), (f, 319)  FineDance: see `dancediff.data.finedance`
    (f, 24, 3)          positions of the joints of SMPL-24, metres

With an axis for dancers in front, the first two and the last may hold a group. No file tells its
frame rate: 30 is taken. Numbers must not be scaled for a network any more.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from dancediff.arrays import read_array
from dancediff.data.finedance import read_motion
from dancediff.data.formats import plain_array
from dancediff.motion.motion import Motion
from dancediff.motion.representation import spec_named
from dancediff.motion.skeleton import SMPL24

WIDTHS = {139: "lodge", 151: "tcdiffpp"}
_FINEDANCE = (315, 319)
_ROW = (0.5, 2.0)  # median length of a rotation's row, which is 1 but for a network's error
_KNOWN = "(f, 139), (f, 151), (f, 315), (f, 319) or (f, 24, 3), some with dancers in front"


def read_rows(path, unit: float = 1.0) -> Motion:
    """A dance as the file has it, its up axis not yet turned; ``unit`` is the file's, in metres.

    Raises: OSError for no such file; ValueError telling which shape or numbers do not fit.
    """
    path = Path(path)
    x = read_array(path)
    if x.ndim == 2 and x.shape[1] in _FINEDANCE:
        return _in_metres(read_motion(path), unit)
    if x.shape[-2:] == (SMPL24.num_joints, 3) and x.ndim in (3, 4):
        points = x[None] if x.ndim == 3 else x
        # what it returns has legs of one length, so its root is in metres already
        return Motion.from_joints(torch.from_numpy(_numbers(points, "positions")) * unit)
    if x.ndim not in (2, 3) or x.shape[-1] not in WIDTHS:
        raise ValueError(f"it has shape {x.shape}, not {_KNOWN}")
    rows = torch.from_numpy(_numbers(x[None] if x.ndim == 2 else x, "rows"))
    name = WIDTHS[x.shape[-1]]
    length = rows[..., spec_named(name).rot6d].unflatten(-1, (-1, 3)).norm(dim=-1)
    if not _ROW[0] < length.median() < _ROW[1] or length.min() < 1e-3:
        raise ValueError(
            f"the rows of its rotations are {length.median():.2f} long where 1 is right; undo the "
            "network's normalisation before saving"
        )
    return _in_metres(Motion.from_features(rows, name=name), unit)


def _in_metres(motion: Motion, unit: float) -> Motion:
    return replace(motion, root=motion.root * unit)


def _numbers(x: np.ndarray, name: str) -> np.ndarray:
    return plain_array(x, name, (None,) * x.ndim)
