r"""Composed groups: real solos and duets put together on one stage.

Read first: `dancediff.data.take`.

Every movement is real, but nobody in it danced with the others: such takes have ``kind``
"composed", and no number about groups may be taken from them alone. They teach a network that
dancers of a group keep apart, and what unison, mirroring and canon look like with real bodies.

Roots of dancers that were put together stay at least 0.45 m apart, which is checked. The partners
of a real duet may come closer than that: they did.

Symbols (axes: n dancers · f frames · d motion features)
    x   motion vectors, not normalised   (n, f, d)
"""

import itertools
from functools import partial
from hashlib import sha256
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dancediff.data.augment import rotate_features, shift_features
from dancediff.data.choreographer.formations import formation_names, slots
from dancediff.data.prepared import AND, Entry, PreparedData
from dancediff.data.soundtrack import with_soundtrack
from dancediff.data.take import NO_MUSIC, DanceTake, Job
from dancediff.data.take_file import read_take
from dancediff.motion.contact import foot_contact
from dancediff.motion.mirror import mirror_features
from dancediff.motion.motion import Motion
from dancediff.motion.representation import TCDIFFPP

MIN_DISTANCE = 0.45  # metres between two roots that were put together
CLEARANCE = 0.7  # metres aimed at, because arms reach farther than roots
WAYS = ("unison", "mirror", "canon")
SHORTEST_COMPOSED = 150  # frames; less is no window
WITHOUT_MUSIC = (NO_MUSIC, "beat-aligned synthetic")  # music of dances recorded without any
WIDEST = 2.6  # times a formation may be stretched so that travelling dancers do not meet


def distance_between(x: Tensor, y: Tensor) -> float:
    """Smallest distance in the stage plane of any dancer of x to any of y, at the same moment.

    Shapes: x (n, f, d), y (n', f, d) -> metres.

    >>> distance_between(torch.zeros(1, 3, 151), shift_features(torch.zeros(2, 3, 151), 3.0, 4.0))
    5.0
    """
    a, b = (part[..., TCDIFFPP.floor] for part in (x, y))
    return (a[:, None] - b[None]).norm(dim=-1).min().item()


def two_duets(a: Motion, b: Motion, rng: np.random.Generator) -> tuple[Motion, dict]:
    """Two groups on one stage, each turned and b beside a, as near as it goes without collision.

    The longer one is cut to the shorter, anywhere. Also returns how it was done.

    Raises: ValueError when they cannot be kept apart.
    """
    f = min(a.num_frames, b.num_frames)
    starts = [int(rng.integers(m.num_frames - f + 1)) for m in (a, b)]
    parts = [
        _centred(m.frames(start, start + f).features())
        for m, start in zip((a, b), starts, strict=True)
    ]
    yaws = rng.uniform(-np.pi, np.pi, 2)
    x, y = (rotate_features(part, yaw) for part, yaw in zip(parts, yaws, strict=True))
    beside = rng.uniform(-np.pi / 6, np.pi / 6) + np.pi * int(rng.integers(2))
    for distance in np.arange(0.8, 6.0, 0.1):
        moved = shift_features(y, distance * np.cos(beside), distance * np.sin(beside))
        if distance_between(x, moved) >= CLEARANCE:
            how = {"starts": starts, "apart": round(float(distance), 2)}
            return _motion([_centred(torch.cat([x, moved]))]), how
    raise ValueError(f"two groups that travel so far cannot be kept {CLEARANCE} m apart on a stage")


def copies(solo: Motion, n: int, way: str, rng: np.random.Generator) -> tuple[Motion, dict]:
    """n copies of a solo on the slots of a formation.

    "unison": all alike; "mirror": every second one mirrored; "canon": each a little later than the
    one before, every second one mirrored or not. Formations are tried in random order, and
    stretched if the copies would meet. Also returns how it was done.

    Raises: ValueError when no formation keeps them apart, or the solo is too short.
    """
    if way not in WAYS:
        raise ValueError(f"way={way!r} is not one of {', '.join(WAYS)}")
    flips = [k % 2 == 1 for k in range(n)] if way == "mirror" else [False] * n
    late = [0] * n
    if way == "canon":
        step = int(rng.integers(8, 31))  # frames: half a beat to two
        late = [step * int(k) for k in rng.permutation(n)]
        if rng.random() < 0.5:
            flips = [k % 2 == 1 for k in range(n)]
    f = solo.num_frames - max(late)
    if f < SHORTEST_COMPOSED:
        raise ValueError(
            f"of {solo.num_frames} frames {f} would be left, less than {SHORTEST_COMPOSED}"
        )
    x = _centred(solo.features())
    cuts = [x[:, max(late) - k : max(late) - k + f] for k in late]
    cuts = [mirror_features(cut) if flip else cut for cut, flip in zip(cuts, flips, strict=True)]
    names = rng.permutation(formation_names(n))
    for scale, name in itertools.product(np.arange(1.0, WIDEST, 0.2), names):
        places = scale * slots(n, str(name))
        placed = [shift_features(cut, *place) for cut, place in zip(cuts, places, strict=True)]
        if all(distance_between(*pair) >= CLEARANCE for pair in itertools.combinations(placed, 2)):
            how = {"way": way, "late": late, "mirrored": flips, "formation": str(name)}
            return _motion(placed), how | {"stretched": round(float(scale), 1)}
    raise ValueError(f"no formation keeps {n} copies {CLEARANCE} m apart, so far does it travel")


def _centred(x: Tensor) -> Tensor:
    middle = x[..., TCDIFFPP.root].mean((0, 1))
    return shift_features(x, -middle[0].item(), -middle[2].item())


def _motion(parts: list[Tensor]) -> Motion:
    motion = Motion.from_features(torch.cat(parts))
    motion.contact = foot_contact(motion.joints())  # a mirrored foot is 2 cm off
    return motion


def composed_jobs(folder, *, songs: int = 2) -> list[Job]:
    """Jobs for all composed takes of a prepared folder's real solos and duets that were silent.

    What people danced to a recording stays with that alone.

    Two duets: each duet with the next one of the same split. Copies: each solo 3, 4 and 5 times,
    in the three ways by turns. A duet that is alone in its split is not composed.

    Raises: ValueError when the folder is not prepared.
    """
    data = PreparedData(folder)
    jobs = []
    for split in ("train", "val", "test"):
        real = [entry for entry in data.split(split) if entry.kind == "real"]
        silent = [entry for entry in real if entry.music in WITHOUT_MUSIC]
        duets = [entry for entry in silent if entry.dancers == 2]
        ring = [*duets, duets[0]] if len(duets) > 2 else duets
        for a, b in pairwise(ring):
            jobs.append(_job(f"pair_{a.name}_{b.name}", data.folder, [a, b], two_duets, songs))
        solos = [entry for entry in silent if entry.dancers == 1]
        for k, entry in enumerate(solos):
            for n in (3, 4, 5):
                way = WAYS[(k + n) % 3]
                arrange = partial(copies, n=n, way=way)
                jobs.append(_job(f"{way}{n}_{entry.name}", data.folder, [entry], arrange, songs))
    return jobs


def _job(name: str, folder: Path, entries: list[Entry], arrange, songs: int) -> Job:
    paths = [folder / entry.file for entry in entries]
    # the recipe of a composed take has the recipes of its parts in it
    recipes = [entry.made_by for entry in entries]
    return Job(name, partial(make_composed, name, paths, arrange, recipes=recipes, songs=songs))


def make_composed(
    name: str, paths: list[Path], arrange, *, recipes: list[str], songs: int
) -> DanceTake:
    """Read takes and ``arrange`` them on one stage; ``recipes`` only tell versions."""
    parts = [read_take(path) for path in paths]
    rng = np.random.default_rng(int.from_bytes(sha256(name.encode()).digest()[:8]))
    motion, how = arrange(*(part.motion for part in parts), rng=rng)
    first = parts[0]
    size = first.motion.num_dancers
    x = motion.features()
    near = min(
        distance_between(x[i : i + size], x[j : j + size])
        for i, j in itertools.combinations(range(0, len(x), size), 2)
    )
    if near < MIN_DISTANCE:
        raise ValueError(f"dancers come within {near:.2f} m, less than {MIN_DISTANCE}")
    made_from = [part.name for part in parts]
    sources = dict.fromkeys(part.source for part in parts)
    take = DanceTake(
        name=name,
        dance=motion,
        kind="composed",
        music=NO_MUSIC,
        source=f"composed of {AND.join(made_from)}; {AND.join(sources)}",
        licence=" AND ".join(dict.fromkeys(part.licence for part in parts)),  # all of them hold
        split=first.split,
        group=AND.join(part.group for part in parts),
        genre=first.genre if all(part.genre == first.genre for part in parts) else None,
        notes={"made_from": made_from, "min_distance": round(near, 3), **how},
    )
    return with_soundtrack(take, songs=songs)
