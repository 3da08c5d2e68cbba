"""Files of SMPL arrays, whose up axis and floor are to be found, as dances that stand.

Read first: `dancediff.data.folder.smpl` · `dancediff.data.folder.rows`.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from dancediff.data.folder.posture import UPS, Given, check_toes, up_axis
from dancediff.data.folder.rows import read_rows
from dancediff.data.folder.smpl import read_smpl
from dancediff.data.formats import on_the_floor, unit_doubts
from dancediff.data.resample import resample_motion
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import rotation_about
from dancediff.motion.skeleton import SMPL24

FLOATS = 0.1  # metres; a floor so far off was never put at 0


@dataclass(frozen=True)
class Standing:
    """A dance with y up and the floor at 0, and what was done for it."""

    motion: Motion
    up: str  # the axis of the file that points up
    floors: list[float]  # how high each dancer's floor was, metres
    doubts: list[str]


def standing(path, given: Given | None = None, *, fps: float | None = None) -> Standing:
    """Read an .npz or .pkl of SMPL arrays or a .npy, turn it upright, put every floor at height 0.

    ``fps`` is what the dance is brought to; None keeps the file's. A file that tells none has 30.

    Raises: OSError for no such file; ValueError telling what is missing or does not fit.
    """
    path, given = Path(path), given or Given()
    if path.suffix.lower() == ".npy":
        motion, tells_rate = read_rows(path, given.unit or 1.0), False
    else:
        motion, tells_rate = read_smpl(path)
        motion = replace(motion, root=motion.root * (given.unit or 1.0))
    motion = replace(motion, fps=given.fps or motion.fps)
    at = _places(motion)
    doubts: list[str] = []
    check_toes(at, doubts)
    if not tells_rate and given.fps is None:
        doubts.append("it tells no frame rate; 30 was taken, else give fps")
    up = given.up or up_axis(_body(at), doubts)
    letter, degrees = UPS[up]
    turn = rotation_about(letter, torch.deg2rad(torch.tensor(degrees)))
    pose = motion.pose.clone()
    pose[:, :, 0] = turn @ pose[:, :, 0]
    motion = replace(motion, pose=pose, root=motion.root @ turn.T)
    motion, floors = on_the_floor(motion if fps is None else resample_motion(motion, fps))
    return Standing(motion, up, floors, doubts + unit_doubts(floors))


def doubts_of(motion: Motion) -> list[str]:
    """What is odd of a dance that is taken as it is: y up, the floor at 0, left at the left.

    >>> standing = Motion(torch.eye(3).expand(1, 30, 24, 3, 3), torch.zeros(1, 30, 3))
    >>> doubts_of(standing)
    ['its floor is at -0.98 m, not at 0: move its points before saving']
    """
    doubts: list[str] = []
    at = _places(motion)
    check_toes(at, doubts)
    up = up_axis(_body(at), [])
    floor = max(on_the_floor(motion)[1], key=abs)
    if up != "y":
        doubts.append(f"its bodies stand along {up}, not y: turn its points before saving")
    elif abs(floor) > FLOATS:
        doubts.append(f"its floor is at {floor:.2f} m, not at 0: move its points before saving")
    return doubts


def _places(motion: Motion) -> dict[str, Tensor]:
    """Joints by name, each (n, f, 3)."""
    return dict(zip(SMPL24.names, motion.joints().unbind(2), strict=True))


def _body(at: dict[str, Tensor]) -> Tensor:
    return at["neck"] - (at["lankle"] + at["rankle"]) / 2
