r"""The CMU dances: 11 salsa duets and 6 Indian solos, from a folder of BVH files and a manifest.

Read first: docs/data.md · `dancediff.data.bvh` · `dancediff.data.retarget`.

``manifest.json`` names the files of each take, the true frame rates (the salsa headers lie), the
glitches that are known, and the split of each take.

Both partners of a duet were recorded in one world, and their files share one skeleton. They keep
that world here: one scale for both, namely that of the legs, which also scales the floor between
them (0.989, so a metre between partners stays 99 cm), and one shift that brings the middle of the
whole take to the middle of the stage. Only heights are fitted for each dancer alone, because a
shared skeleton puts the shorter partner's feet too low or too high. Arms keep their directions, so
hands that hold each other are as far apart as SMPL-24's wider shoulders make them.
"""

from functools import partial
from pathlib import Path

import torch

from dancediff.data.bvh import read_bvh
from dancediff.data.formats import read_json
from dancediff.data.joint_maps import find_joints
from dancediff.data.retarget import leg_scale, retarget
from dancediff.data.summary import MEASURED
from dancediff.data.take import NO_MUSIC, SPLITS, DanceTake, Job
from dancediff.motion.motion import Motion

GENRE = {"salsa": "captured_salsa", "indian": "indian"}  # "salsa" is the choreographer's
LEAD = 6  # frames dropped: the added T-pose, and five into which the conversion's filter smears it


def cmu_jobs(src) -> list[Job]:
    """One job for each take of the manifest: salsa_01.. with two dancers, indian_04.. with one.

    Raises: ValueError when ``src`` has no manifest of the expected form.
    """
    src = Path(src)
    manifest = _manifest(src)
    texts = {key: str(manifest[key]) for key in ("source", "licence")}
    jobs = []
    try:
        salsa, indian = manifest["salsa"], manifest["indian"]
        takes = [
            ("salsa", salsa["fps_true"], row, [row["a"], row["b"]], row.get("spike_frames_a", []))
            for row in salsa["pairs"]
        ]
        takes += [("indian", indian["fps_true"], r, [r["file"]], []) for r in indian["takes"]]
        for kind, fps, row, files, spikes in takes:
            name, genre = f"{kind}_{row['take']:02d}", GENRE[kind]
            _check(name, fps, files, spikes, row["split"])
            paths = [src / file for file in files]
            make = partial(make_take, name, paths, fps, spikes, genre, row["split"], **texts)
            jobs.append(Job(name, make))
    except (KeyError, TypeError, AttributeError) as err:
        raise ValueError(f"{src / 'manifest.json'} lacks {err}") from err
    return jobs


def _check(name: str, fps, files, spikes, split) -> None:
    """Refuse a take whose entries in the manifest are not of their kind."""
    pairs = isinstance(spikes, list) and all(
        isinstance(pair, list) and len(pair) == 2 and all(type(k) is int for k in pair)
        for pair in spikes
    )
    rate = type(fps) in (int, float) and 0 < fps < 1e4
    texts = all(isinstance(file, str) and file and "\0" not in file for file in files)
    if not (pairs and rate and texts and split in SPLITS):
        raise ValueError(
            f"manifest.json: {name} has fps {fps!r}, files {files!r}, spikes {spikes!r} and split "
            f"{split!r}; expected a number, names, pairs of frames, and one of {', '.join(SPLITS)}"
        )


def make_take(
    name: str, paths: list[Path], fps: float, spikes: list, genre: str, split: str,
    *, source: str, licence: str,
) -> DanceTake:  # fmt: skip
    """Read, repair and retarget the dancers of one take; ``spikes`` belong to the first of them.

    ``notes`` holds what `retarget` measured for each dancer ("dancers"), and for the take the mean
    over its dancers, of penetration the worst.

    Raises: ValueError naming the file that is missing or unreadable.
    """
    recordings = [_read(path, fps) for path in paths]
    scales = [leg_scale(bvh, find_joints(bvh.names, "cmu")) for bvh in recordings]
    scale = sum(scales) / len(scales)
    # the manifest counts frames without the T-pose
    known = [(first - (LEAD - 1), last - (LEAD - 1)) for first, last in spikes]
    done = [
        retarget(bvh, "cmu", scale=scale, suspect=() if k else known)
        for k, bvh in enumerate(recordings)
    ]
    return DanceTake(
        name=name,
        dance=_on_one_stage([motion for motion, _ in done], name),
        kind="real",
        music=NO_MUSIC,
        source=source,
        licence=licence,
        split=split,
        group=name,
        genre=genre,
        notes=_notes([measured for _, measured in done]),
    )


def _manifest(src: Path) -> dict:
    path = src / "manifest.json"
    if not path.exists():
        raise ValueError(f"{path} does not exist; data_prep/README.md says what it must hold")
    manifest = read_json(path)
    missing = {"source", "licence", "salsa", "indian"} - set(manifest)
    if missing:
        raise ValueError(f"{path} lacks {', '.join(sorted(missing))}")
    return manifest


def _read(path: Path, fps: float):
    try:
        return read_bvh(path, fps=fps).frames(LEAD)
    except (OSError, ValueError) as err:
        raise ValueError(f"{path}: {err}") from err


def _on_one_stage(solos: list[Motion], name: str) -> Motion:
    """Stack dancers of one world, cut to the shortest, the take's middle over the stage's."""
    f = min(solo.num_frames for solo in solos)
    pose, root, contact = (
        torch.cat([getattr(solo, part)[:, :f] for solo in solos])
        for part in ("pose", "root", "contact")
    )
    middle = root.mean((0, 1)) * root.new_tensor([1.0, 0.0, 1.0])
    return Motion(pose, root - middle, solos[0].fps, contact=contact, meta={"name": name})


def _notes(measured: list[dict]) -> dict:
    for row in measured:
        for entry in row["repairs"]:
            entry["first"] += LEAD - 1
            entry["last"] += LEAD - 1
    notes = {key: sum(row[key] for row in measured) / len(measured) for key in MEASURED}
    notes["penetration_p95"] = max(row["penetration_p95"] for row in measured)
    notes["repaired"] = sum(len(row["repairs"]) for row in measured)
    return {**notes, "scale": measured[0]["scale"], "dancers": measured}
