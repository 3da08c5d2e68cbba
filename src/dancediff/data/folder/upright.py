"""Files of SMPL arrays, whose up axis and floor are to be found, as dances that stand.

Read first: `dancediff.data.folder.smpl` · `dancediff.data.folder.rows`.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import torch

from dancediff.data.folder.posture import UPS, Given, up_axis
from dancediff.data.folder.rows import read_rows
from dancediff.data.folder.smpl import read_smpl
from dancediff.data.formats import on_the_floor
from dancediff.data.resample import resample_motion
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import rotation_about
from dancediff.motion.skeleton import SMPL24


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
    points, at = motion.joints(), SMPL24.index
    body = points[:, :, at("neck")] - points[:, :, [at("lankle"), at("rankle")]].mean(2)
    doubts: list[str] = []
    if not tells_rate and given.fps is None:
        doubts.append("it tells no frame rate; 30 was taken, else give fps")
    up = given.up or up_axis(body, doubts)
    letter, degrees = UPS[up]
    turn = rotation_about(letter, torch.deg2rad(torch.tensor(degrees)))
    pose = motion.pose.clone()
    pose[:, :, 0] = turn @ pose[:, :, 0]
    motion = replace(motion, pose=pose, root=motion.root @ turn.T)
    motion, floors = on_the_floor(motion if fps is None else resample_motion(motion, fps))
    return Standing(motion, up, floors, doubts)
