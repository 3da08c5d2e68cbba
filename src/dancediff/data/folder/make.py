r"""A take from files of motion capture of any kind.

Read first: `dancediff.data.folder.posture` · `dancediff.data.retarget`.

Dancers of one take share a world: one scale for all, and one shift that brings the middle of the
whole take to the middle of the stage. Only heights are fitted for each dancer alone.
"""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dancediff.arrays import COMPRESSED, read_arrays
from dancediff.axes import FPS
from dancediff.data.bvh import BVH, read_bvh
from dancediff.data.folder.gltf import chunks, read_gltf
from dancediff.data.folder.posture import Found, Given, settle
from dancediff.data.folder.takes import TakePlan
from dancediff.data.folder.tree import tree_of_motion
from dancediff.data.folder.upright import doubts_of, standing
from dancediff.data.formats import drawn_split, make_take
from dancediff.data.names import short_hash
from dancediff.data.resample import resample_motion
from dancediff.data.retarget import leg_scale, retarget
from dancediff.data.song_folder import UNKNOWN
from dancediff.data.soundtrack import with_soundtrack
from dancediff.data.summary import MEASURED
from dancediff.data.take import KINDS, DanceTake
from dancediff.data.take_file import read_row
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import SMPL24
from dancediff.music.song import Music

SLIDES = 0.7  # share of the frames with a foot down; real dancers stay below 0.55
FAR_OFF = 6.0  # degrees of mean direction error; recordings that fit stay below 3
REPAIRED = 0.1  # share of frames in which something was replaced
STILL = 0.03  # metres a second of the mean joint; dances have half a metre
UNEVEN = 5  # frames by which files of one take may differ in length; recorders stop so far apart
Draw = Callable[[str, list[tuple[Tensor, tuple[int, ...], float]], Motion, Path], None]


@dataclass
class Dancer:
    """One dancer of a take: the dance, and the source's joints in metres, y up."""

    motion: Motion
    source: tuple[Tensor, tuple[int, ...], float]  # (f, j, 3), parents, frames a second
    numbers: dict = field(default_factory=dict)
    skeleton: dict | None = None  # what was found of a joint tree; SMPL needs none
    repaired: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    kind: str = "real"  # of the motion, as of a `DanceTake`


def make_folder_take(
    plan: TakePlan, givens: tuple[Given, ...], *, draw: Draw | None = None, pictures: Path | None,
) -> DanceTake:  # fmt: skip
    """Read, turn upright, repair and retarget the dancers of a take, and look what is in doubt.

    Raises: ValueError naming the file and what is wrong with it.
    """
    read: list[tuple[str, Found | Dancer]] = []
    for path, label, given in zip(plan.files, plan.labels, givens, strict=True):
        with _named(label):
            read += [(label, one) for one in read_file(path, given)]
    lead = max((one.lead / one.bvh.fps for _, one in read if isinstance(one, Found)), default=0.0)
    scales = [leg_scale(one.bvh, one.joints) for _, one in read if isinstance(one, Found)]
    scale = sum(scales) / max(len(scales), 1)
    kinds = [told_kind(path) for path in plan.files]
    dancers = []
    for label, one in read:
        with _named(label):
            dancers.append(_dancer(one, label, scale, lead))
    kinds += [dancer.kind for dancer in dancers]
    motion = _on_one_stage([dancer.motion for dancer in dancers])
    doubts = [doubt for dancer in dancers for doubt in dancer.doubts]
    if _speed(motion) < STILL:
        doubts.append("nobody moves in it")
    doubts += _cut_doubts(dancers, [label for label, _ in read])
    if plan.song is not None:
        doubts += _length_doubts(motion, Music.load(plan.song))
    notes = {
        "files": list(plan.labels),
        # found from the files: as an argument it would make all anew once the source is moved
        "folder": place_of(plan.files[0].parents[plan.labels[0].count("/")]),
        "skeletons": [dancer.skeleton for dancer in dancers if dancer.skeleton],
        "repaired": list(dict.fromkeys(one for d in dancers for one in d.repaired)),
        "doubts": list(dict.fromkeys(doubts)),
        **_mean_numbers([dancer.numbers for dancer in dancers if dancer.numbers]),
    }
    group = plan.name if plan.song is None else song_group(plan.song)
    take = make_take(
        plan.name,
        motion,
        plan.song,
        skip=round(lead * FPS),
        notes=notes,
        source=plan.source or f"files {', '.join(plan.labels)}"[:200],
        licence=plan.licence or UNKNOWN,
        split=plan.split or drawn_split(f"folder {group}"),
        group=group,
        genre=plan.genre,
        kind=plan.kind or max(kinds, key=KINDS.index),
    )
    if draw is not None and pictures is not None:
        draw(plan.name, [dancer.source for dancer in dancers], take.motion, pictures)
    return with_soundtrack(take) if take.M is None else take


@contextlib.contextmanager
def _named(label: str) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as err:
        raise ValueError(f"{label}: {err}") from err


def place_of(src: Path) -> str:
    """A hash of where a folder of motion lies: by it a later run knows the takes made from it."""
    return short_hash(str(src.resolve()))


def song_group(song: Path) -> str:
    """One song is one group wherever it lies; two of one name in two folders are not."""
    return f"song {sha256(song.read_bytes()).hexdigest()[:12]}"


def read_file(path: Path, given: Given) -> list[Found | Dancer]:
    """All dancers of a file: joint trees made upright, or dancers that need no retargeting.

    Raises: OSError or ValueError telling what is wrong with it.
    """
    kind = path.suffix.lower()
    if kind == ".bvh":
        trees = [read_bvh(path, fps=given.fps, scale=1.0)]
    elif kind in (".glb", ".gltf"):
        trees = read_gltf(path)
    elif kind == ".npz" and "rot6d" in read_arrays(path, ("rot6d",), expand=COMPRESSED):
        motion = Motion.load(path)
        if motion.skeleton.names == SMPL24.names:
            doubts = [*_unused(given), *doubts_of(motion)]
            facts = {"kind": _kind_of(path, motion), "doubts": doubts}
            return [*_as_they_are(resample_motion(motion), **facts)]
        trees = [tree_of_motion(motion, k) for k in range(motion.num_dancers)]
    else:
        return [*_smpl_dancers(path, given)]
    return [settle(tree, given) for tree in trees]


def _unused(given: Given) -> list[str]:
    names = [name for name in ("fps", "up", "unit") if getattr(given, name) is not None]
    return [f"given {', '.join(names)} not used: the file tells its own"] if names else []


def _dancer(one: Found | Dancer, label: str, scale: float, lead: float) -> Dancer:
    """The dancer without so many seconds at the start, which nobody of the take may keep."""
    if isinstance(one, Dancer):
        motion, (points, parents, fps) = one.motion, one.source
        one.motion = motion.frames(round(lead * motion.fps), motion.num_frames)
        return replace(one, source=(points[round(lead * fps) :], parents, fps))
    if lead > 0:
        one.repaired.append(f"the first {lead:.3f} s are left out: they begin in a T-pose")
    return _retargeted(one, one.bvh.frames(round(lead * one.bvh.fps)), label, scale)


def _retargeted(found: Found, bvh: BVH, label: str, scale: float) -> Dancer:
    motion, numbers = retarget(bvh, found.joints, scale=scale)
    repairs = numbers.pop("repairs")
    repaired = list(found.repaired)
    if repairs:
        frames = sum(row["last"] - row["first"] + 1 for row in repairs if row["joint"] == "body")
        joints = sorted({row["joint"] for row in repairs})
        repaired.append(f"{len(repairs)} stretches of {', '.join(joints[:6])}")
        if frames > REPAIRED * bvh.num_frames:
            found.doubts.append(
                f"the whole body was replaced in {frames} of {bvh.num_frames} frames"
            )
    if numbers["skating"] > SLIDES:
        found.doubts.append(
            f"feet slide in {numbers['skating']:.0%} of the frames: fps or the unit may be wrong"
        )
    if numbers["direction_error"] > FAR_OFF:
        found.doubts.append(f"limbs are {numbers['direction_error']:.0f} degrees off: check joints")
    source = (bvh.world()[0].float(), bvh.parents, bvh.fps)
    skeleton = {"file": label, "joints": found.joints, **found.facts}
    return Dancer(motion, source, numbers, skeleton, repaired, found.doubts)


def _kind_of(path: Path, motion: Motion) -> str:
    """What a prepared take says of itself; else whether a network or the choreographer made it."""
    if "take" in read_arrays(path, ("take",), expand=COMPRESSED):
        return read_row(path)["kind"]
    return "synthetic" if motion.is_synthetic else "real"


def told_kind(path: Path) -> str:
    """What a file of other programs' formats says of its motion; only our own exports say it.

    Of those a .bvh says nothing: BVH has no place for a mark, and a comment or another name of the
    root breaks readers.
    """
    synthetic = False
    if path.suffix.lower() == ".glb":
        content = path.read_bytes()
        book = chunks(content)[0] if content[:4] == b"glTF" else {}
        extras = book.get("asset", {}).get("extras", {})
        synthetic = isinstance(extras, dict) and extras.get("synthetic") is True
    elif path.suffix.lower() == ".npz":
        marks = read_arrays(path, ("synthetic",), expand=COMPRESSED)
        synthetic = bool(np.any(marks.get("synthetic", False)))
    return "synthetic" if synthetic else "real"


def _as_they_are(motion: Motion, **facts) -> list[Dancer]:
    """Dancers that need no retargeting."""
    points = motion.joints()
    return [
        Dancer(motion.dancer(k), (points[k], SMPL24.parents, motion.fps), **facts)
        for k in range(motion.num_dancers)
    ]


def _smpl_dancers(path: Path, given: Given) -> list[Dancer]:
    """Dancers of a file of arrays, turned upright and put on the floor."""
    found = standing(path, given, fps=FPS)
    dancers = _as_they_are(found.motion)
    for dancer, floor in zip(dancers, found.floors, strict=True):
        dancer.doubts += found.doubts
        if abs(floor) > 0.01:
            dancer.repaired.append(f"{found.up} up; moved {-floor:+.2f} m to the floor")
    return dancers


def _on_one_stage(solos: list[Motion]) -> Motion:
    """Stack dancers of one world, cut to the shortest, the take's middle over the stage's."""
    f = min(solo.num_frames for solo in solos)
    pose, root = (
        torch.cat([getattr(one, part)[:, :f] for one in solos]) for part in ("pose", "root")
    )
    middle = root.mean((0, 1)) * root.new_tensor([1.0, 0.0, 1.0])
    return Motion(pose, root - middle, solos[0].fps)


def _speed(motion: Motion) -> float:
    """Of the mean joint, metres a second."""
    return motion.joints().diff(dim=1).norm(dim=-1).mean().item() * motion.fps


def _cut_doubts(dancers: list[Dancer], labels: list[str]) -> list[str]:
    """A file that is far shorter than another cuts the whole take: perhaps it is not of it."""
    frames = [dancer.motion.num_frames for dancer in dancers]
    short, long = min(frames), max(frames)
    if long - short <= UNEVEN:
        return []
    file = labels[frames.index(short)]
    return [f"cut to the {short} frames of {file}, its shortest file; its longest has {long}"]


def _length_doubts(motion: Motion, song: Music) -> list[str]:
    """A song of half or twice the length tells of a wrong frame rate."""
    ratio = motion.duration / song.duration
    for times in (0.5, 2.0, 4.0):
        if abs(ratio / times - 1) < 0.02:
            return [f"the motion lasts {ratio:.2f} times as long as its song: fps may be wrong"]
    return []


def _mean_numbers(rows: list[dict]) -> dict:
    """Of what was measured the mean over dancers, of penetration the worst."""
    rows = [row for row in rows if set(MEASURED) <= set(row)]
    if not rows:
        return {}
    mean = {key: sum(row[key] for row in rows) / len(rows) for key in MEASURED}
    return mean | {"penetration_p95": max(row["penetration_p95"] for row in rows)}
