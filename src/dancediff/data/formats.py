r"""What the readers of AIOZ-GDance, FineDance and AIST++ share.

Read first: `dancediff.data.take`.

All three keep a dance as rotations of the SMPL joint tree and a path of its root, y up. Our
`Motion` takes the path as that of the pelvis. SMPL itself adds the pelvis' rest position to it, a
constant of 22 cm in height and 3 cm in depth; the height is gone once the floor is at 0.

Symbols (axes: n dancers · f frames · j joints · m music features)
    poses   axis-angle vectors, radians       (n, f, 3 j)
    trans   path of the root, metres          (n, f, 3)
    M       music features, raw               (f, m)
"""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import torch

from dancediff.data.cache import song_features
from dancediff.data.resample import resample_motion
from dancediff.data.retarget import floor_height
from dancediff.data.safe_pickle import load_pickle
from dancediff.data.take import NO_MUSIC, DanceTake
from dancediff.motion.contact import foot_contact
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import FOOT_JOINTS
from dancediff.music.features import beat_times
from dancediff.music.song import Music
from dancediff.music.sound_on_disk import SOUND_SUFFIXES

VAL_SHARE = 0.1
SHORTEST_TAKE = 30  # frames; what is shorter holds nothing to learn from
HIGH = 5.0  # metres; nobody puts the origin so far above or below a floor
FARTHEST = 100  # metres from the origin; nobody dances there, so the unit is wrong
_NAME = re.compile(r"[A-Za-z0-9_-]{1,100}")


def plain_array(value, name: str, shape: tuple) -> np.ndarray:
    """``value`` as float64, when it is an array of finite numbers of that shape; None fits any.

    Raises: ValueError naming the array and its shape.

    >>> plain_array(np.zeros((4, 3), dtype=np.float32), "root_trans", (None, 3)).dtype
    dtype('float64')
    """
    wanted = " x ".join("any" if k is None else str(k) for k in shape)
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
        raise ValueError(f"{name} is {type(value).__name__}, not an array {wanted} of numbers")
    fits = value.ndim == len(shape) and all(
        k in (None, has) for k, has in zip(shape, value.shape, strict=True)
    )
    if not fits or value.size == 0:
        raise ValueError(f"{name} has shape {value.shape}, not {wanted}")
    if not np.isfinite(value).all():
        raise ValueError(f"{name} has numbers that are not finite")
    return value.astype(np.float64)


def smpl_motion(poses: np.ndarray, trans: np.ndarray, fps: float) -> Motion:
    """A dance from SMPL's axis-angle vectors, at 30 frames a second, cut to the shorter of the two.

    Shapes: poses (n, f, 72) radians, trans (n, f', 3) metres, y up.
    Raises: ValueError when the numbers of dancers differ.
    """
    if len(poses) != len(trans):
        raise ValueError(f"there are poses of {len(poses)} dancers and paths of {len(trans)}")
    f = min(poses.shape[1], trans.shape[1])
    v = torch.from_numpy(poses[:, :f]).float().unflatten(-1, (24, 3))
    return resample_motion(Motion(axis_angle_to_matrix(v), torch.from_numpy(trans[:, :f]), fps))


def on_the_floor(motion: Motion) -> tuple[Motion, list[float]]:
    """Put every dancer's floor at height 0; also returns how high it was, in metres.

    Each dancer has a floor of their own, because the files' body shapes are not used: all dance
    with legs of one length. Floor: the median height of the lower toe while it stands.
    """
    feet = motion.joints()[:, :, FOOT_JOINTS]
    floors = [floor_height(dancer, motion.fps) for dancer in feet]
    down = torch.zeros(motion.num_dancers, 1, 3)
    down[:, 0, 1] = torch.tensor(floors)
    return replace(motion, root=motion.root - down), [round(floor, 4) for floor in floors]


def unit_doubts(floors: list[float]) -> list[str]:
    """What heights of floors tell of the unit of a path: of centimetres they are near 90.

    >>> unit_doubts([-0.02, 0.9]), unit_doubts([0.0, 88.0])
    ([], ['a floor was at 88.0 m: its unit may not be metres'])
    """
    off = max(floors, key=abs)
    high = abs(off) > HIGH
    return [f"a floor was at {off:.1f} m: its unit may not be metres"] if high else []


PoseReader = Callable[[dict], tuple[np.ndarray, np.ndarray]]  # rotations and path


def smpl_take(
    name: str, path: Path, song: Path | None, read_poses: PoseReader, fps: float, **facts
) -> DanceTake:
    """A take from a pickle of SMPL poses, of which ``read_poses`` tells rotations and path.

    Each dancer's floor is at 0; ``notes`` has its height, ``facts`` are the take's other fields.

    Raises: ValueError naming the file and what is wrong with it.
    """
    data = load_pickle(path)
    try:
        if not isinstance(data, dict):
            raise ValueError(f"it holds a {type(data).__name__}, not a dict")
        motion, floors = on_the_floor(smpl_motion(*read_poses(data), fps))
        notes = {"floors": floors, "doubts": unit_doubts(floors), **facts.pop("notes")}
        return make_take(name, motion, song, notes=notes, **facts)
    except ValueError as err:
        raise ValueError(f"{path}: {err}") from err


def make_take(
    name: str, motion: Motion, song: Path | None, *, skip: int = 0, kind: str = "real", **facts
) -> DanceTake:
    """A take of ``motion`` and the music it was danced to, cut to the shorter of the two.

    Features are those of the whole song, cut to rows. ``song`` may be None or silent: then the take
    has no music. ``skip`` are the frames that were already cut from the start of the motion.
    ``facts`` are further fields of `DanceTake`. ``notes`` tells both lengths where they differ.

    Raises: ValueError naming the song or what else is wrong: too short, or nowhere near the origin.
    """
    far = motion.root.abs().max().item()
    if not far <= FARTHEST:
        raise ValueError(
            f"the root is {far:.0f} m from the origin; its unit is not metres "
            "(`prepare folder` takes --unit)"
        )
    M, notes = None, dict(facts.pop("notes", {}))
    if song is not None:
        music = Music.load(song)
        notes |= {"song": song.name}
        M = None if music.is_silent else song_features(music)[skip:]
        if M is None:
            notes |= {"silent": True}
    f = motion.num_frames if M is None else min(motion.num_frames, len(M))
    if f < SHORTEST_TAKE:
        of = "" if M is None else f" and music of {len(M)}"
        raise ValueError(
            f"a motion of {motion.num_frames} frames{of} is shorter than {SHORTEST_TAKE} frames"
        )
    if M is not None and len(M) != motion.num_frames:
        notes |= {"motion_frames": motion.num_frames, "music_frames": len(M)}
    motion = motion.frames(0, f)
    # exports of the take say by its meta that nobody danced it
    meta = {"name": name} | ({"synthetic": True} if kind == "synthetic" else {})
    return DanceTake(
        name=name,
        dance=replace(motion, contact=foot_contact(motion.joints(), motion.fps), meta=meta),
        kind=kind,
        music=NO_MUSIC if M is None else "original",
        M=None if M is None else M[:f].clone(),
        beats=None if M is None else beat_times(M[:f]),
        notes=notes,
        **facts,
    )


def find_song(folders: list[Path], names: list[str]) -> Path | None:
    """The first file with one of the names and the suffix of a sound, in the first such folder."""
    places = [folder / name for folder in folders for name in names]
    ends = [how(end) for end in SOUND_SUFFIXES for how in (str.lower, str.upper, str.title)]
    files = (place.with_name(place.name + end) for place in places for end in ends)
    return next((file for file in files if file.is_file()), None)


def read_names(path: Path) -> list[str]:
    """The names in a list, one a line; what follows a comma is left out.

    Raises: ValueError naming the file, and the line when that is no name of a take.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError) as err:
        raise ValueError(f"{path} cannot be read as a list of names: {err}") from err
    names = [line.split(",")[0].strip() for line in lines]
    for number, name in enumerate(names, 1):
        if name and not _NAME.fullmatch(name):
            raise ValueError(f"{path}, line {number}: {name[:100]!r} is no name of a take")
    return [name for name in names if name]


def read_splits(lists: dict[str, Path]) -> dict[str, str]:
    """The split of each name, from one list a split; a split without a list is empty.

    Raises: ValueError when there is no list at all, or a name is in two of them.
    """
    found = {split: path for split, path in lists.items() if path.is_file()}
    if not found:
        raise ValueError(
            f"there are no lists of takes; expected {', '.join(map(str, lists.values()))}"
        )
    splits: dict[str, str] = {}
    for split, path in found.items():
        for name in read_names(path):
            if splits.setdefault(name, split) != split:
                raise ValueError(f"{name} is in the lists of {splits[name]} and of {split}")
    return splits


def drawn_split(group: str) -> str:
    """Train or val for a group of takes that no list puts anywhere: val for one in ten names.

    >>> [drawn_split(f"video {k}") for k in range(20)].count("val")
    2
    """
    side = int.from_bytes(sha256(group.encode()).digest()[:8])
    return "val" if side < VAL_SHARE * 2**64 else "train"


def group_takes(splits: dict[str, str], key: Callable[[str], str]) -> dict[str, str]:
    """The group of each take: what they share, once for each split that it is in.

    The official splits win where they part what belongs together; those groups carry the split.

    >>> group_takes({"a1": "train", "a2": "train", "b1": "val", "b2": "test"}, lambda name: name[0])
    {'a1': 'a', 'a2': 'a', 'b1': 'b in val', 'b2': 'b in test'}
    """
    sides: dict[str, set[str]] = {}
    for name, split in splits.items():
        sides.setdefault(key(name), set()).add(split)
    parted = {group for group, side in sides.items() if len(side) > 1}
    return {
        name: f"{key(name)} in {split}" if key(name) in parted else key(name)
        for name, split in splits.items()
    }


def read_json(path: Path) -> dict:
    """The object in a JSON file.

    Raises: ValueError naming the file when there is none.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as err:
        raise ValueError(f"{path} cannot be read as JSON: {err}") from err
    if not isinstance(content, dict):
        raise ValueError(f"{path} holds a {type(content).__name__}, not an object with fields")
    return content
