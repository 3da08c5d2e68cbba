r"""FineDance: long solos of one professional each, in 16 genres, 30 frames a second.

Read first: `dancediff.data.formats`.

    motion/NNN.npy          (f, 315): root path 3, then 52 rotations of 6 numbers; y up, metres
    music_wav/NNN.wav       f may differ by a few frames
    label_json/NNN.json     song, coarse style, and the genre in "style2"

NNN is 001 to 211, not all of which are public. Some copies have mirrored motions, M001.npy and so
on; they are left out, because we mirror ourselves. ``music_npy`` is not read either, so that all
data sets get their features from one extractor.

The 52 joints are those of SMPL-H: 22 of the body and 30 of the fingers. The fingers are dropped,
and the two hand joints of SMPL-24 rest. The bodies have shorter legs than SMPL-24 by 3.7 percent;
the root's path is scaled by as much, so that a planted foot stays planted.

Symbols (axes: f frames)
"""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.data.formats import find_song, make_take, plain_array, read_json
from dancediff.data.names import take_name
from dancediff.data.take import DanceTake, Job
from dancediff.genre import FINEDANCE
from dancediff.motion.contact import TOE_CLEARANCE
from dancediff.motion.motion import Motion
from dancediff.motion.representation import whole_pose
from dancediff.motion.rotation import rot6d_to_matrix
from dancediff.motion.skeleton import FOOT_JOINTS

BODY = 22
LEGS = 1.038  # length of SMPL-24's legs over that of the neutral SMPL-X body
LEVEL = 0.02  # metres: toes that differ by less stand on the floor together
SOURCE = "FineDance (Li et al., ICCV 2023), github.com/li-ronghui/FineDance"
LICENCE = "FineDance licence: non-commercial scientific research, no redistribution"


def _ids(text: str) -> frozenset[str]:
    """Ids from "3 5-7": 003, 005, 006, 007."""
    ends = [part.split("-") for part in text.split()]
    return frozenset(f"{k:03d}" for end in ends for k in range(int(end[0]), int(end[-1]) + 1))


ALL = _ids("1-211")
IGNORED = _ids("116-123 202")
_TEST = _ids("63 132 143 36 98 198 130 12 211 193 179 65 137 161 92 120 37 109 204 144")
_SPLITS = {  # 120 is in the official test list and in the ignore list, which wins
    "genre": {"test": _TEST},
    "dancer": {
        "test": _ids("1-13 124 126 128 130 132"),
        "val": _ids("115 117 119 121 122 135 137 139 141 143 145 147"),
    },
}
SKIP = {  # frames at the start: three broken ones, or an intro in which little happens
    **dict.fromkeys(("010", "014"), 3),
    **{"004": 240, "005": 300, "067": 180, "105": 570, "110": 420, "113": 870, "153": 1560},
    "211": 660,
}
_SAME = {"tai": "Dai", "uighur": "Wei", "hmong": "Miao"}
_GENRE = {**{genre.lower(): genre for genre in FINEDANCE}, **_SAME}


def finedance_jobs(src, *, split: str = "genre") -> list[Job]:
    """One job for each motion file but the ignored and the mirrored ones.

    ``split`` is "genre", which both papers use and which has no validation set, or "dancer".

    Raises: ValueError for another ``split``, or when ``src`` holds no motions.
    """
    if split not in _SPLITS:
        raise ValueError(f"split={split!r} is not one of {', '.join(_SPLITS)}")
    src = Path(src)
    names = sorted(path.stem for path in (src / "motion").glob("*.npy"))
    if not names:
        raise ValueError(f"{src / 'motion'} holds no .npy files; unpack FineDance there")
    jobs = []
    for name in names:
        if name not in IGNORED and not (name[0] == "M" and name[1:] in ALL):
            path, label = src / "motion" / f"{name}.npy", src / "label_json" / f"{name}.json"
            song = find_song([src / "music_wav"], [name])
            make = partial(make_finedance, path, song, label, split_of(name, split))
            jobs.append(Job(f"finedance_{take_name(name)}", make))
    return jobs


def split_of(name: str, split: str = "genre") -> str:
    """The split of a dance, "train" where no list names it.

    >>> split_of("063"), split_of("064"), split_of("115", "dancer")
    ('test', 'train', 'val')
    """
    return next((side for side, names in _SPLITS[split].items() if name in names), "train")


def make_finedance(path: Path, song: Path | None, label: Path, split: str) -> DanceTake:
    """Read one dance and its music, without the start that `SKIP` names, the floor at 0.

    Raises: ValueError naming the file and what is wrong with it.
    """
    name, skip = path.stem, SKIP.get(path.stem, 0)
    try:
        if name not in ALL:
            raise ValueError("its name is none of 001 to 211, so its split is not known")
        motion = read_motion(path)
        if motion.num_frames <= skip:
            raise ValueError(f"it has {motion.num_frames} frames; the first {skip} are to be cut")
        motion = motion.frames(skip, motion.num_frames)
        floor = first_floor(motion.joints())
        motion = replace(motion, root=motion.root - motion.root.new_tensor([0, floor, 0]))
        genre, style = _genre(label)
        return make_take(
            f"finedance_{name}",
            motion,
            song,
            skip=skip,
            source=SOURCE,
            licence=LICENCE,
            split=split,
            group=f"finedance {name}",
            genre=genre,
            notes={"floors": [round(floor, 4)], "skipped": skip, "style2": style},
        )
    except ValueError as err:
        raise ValueError(f"{path}: {err}") from err


def read_motion(path: Path) -> Motion:
    """A file's dance on SMPL-24, its floor where it was. Contacts of 319-wide files are dropped.

    Raises: ValueError when it is no array of 315 or 319 columns, or has rotations of length 0.
    """
    try:
        # mapped, not read: a header may promise more than the file holds
        x = np.lib.format.open_memmap(path, mode="r")
    except (OSError, EOFError, SyntaxError, TypeError, OverflowError, MemoryError) as err:
        raise ValueError(f"it cannot be read as an array ({type(err).__name__}: {err})") from err
    if not isinstance(x, np.ndarray) or x.ndim != 2 or x.shape[1] not in (315, 319):
        raise ValueError(f"it has shape {getattr(x, 'shape', None)}, not any x 315 (or 319)")
    row = torch.from_numpy(plain_array(x[:, -315:], "motion", (None, 315))).float()
    root, d6 = row[:, :3] * LEGS, row[:, 3 : 3 + 6 * BODY].unflatten(-1, (BODY, 6))
    if d6.unflatten(-1, (2, 3)).norm(dim=-1).min() < 1e-3:
        raise ValueError("it has rotations of length 0")
    return Motion(whole_pose(rot6d_to_matrix(d6))[None], root[None], FPS)


def first_floor(joints: Tensor) -> float:
    """Height of the floor under the toes of the first frame, joints (n, f, j, 3) of a solo.

    Source: Lodge's preprocessing: the mean height of the toes when they are level within 2 cm, else
    the lower one.  Differs: the joint of a toe that stands on our floor is 2 cm above it, not at 0.
    """
    toes = joints[0, 0, FOOT_JOINTS[2:], 1]
    level = (toes[0] - toes[1]).abs() < LEVEL
    return (toes.mean() if level else toes.min()).item() - TOE_CLEARANCE


def _genre(path: Path) -> tuple[str | None, str | None]:
    """The genre under its one name, and the label as it is written; None without a label."""
    if not path.is_file():
        return None, None
    style = read_json(path).get("style2")
    if style is not None and not isinstance(style, str):
        raise ValueError(f"{path}: style2 is a {type(style).__name__}, not the name of a genre")
    return _GENRE.get((style or "").strip().lower()), style
