r"""Motion capture as BVH files: a reader for any of them. The writer is `dancediff.export.bvh`.

Read first: `dancediff.motion.skeleton`.

A BVH file is a joint tree with rest offsets (HIERARCHY) and one line of numbers per frame (MOTION).

Symbols (axes: f frames · j joints, End Sites included)
    offsets       where a joint sits on its parent at rest, metres   (j, 3)
    rotations     of each joint relative to its parent               (f, j, 3, 3)
    translations  offset of each joint in each frame, metres         (f, j, 3)
"""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dancediff.motion.rotation import rotation_about

CENTIMETRE = 0.01
END = "_end"  # an End Site has no name of its own: it is called after its joint
MAX_FPS = 1000.0
_CHANNELS = {f"{axis}{kind}": (kind, i) for i, axis in enumerate("xyz")
             for kind in ("position", "rotation")}  # fmt: skip


@dataclass(frozen=True, eq=False)
class BVH:
    """A recorded motion of any joint tree. Float64; parents stand before their children."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Tensor = field(repr=False)
    rotations: Tensor = field(repr=False)
    translations: Tensor = field(repr=False)
    fps: float

    @property
    def num_frames(self) -> int:
        """Length in frames."""
        return self.rotations.shape[0]

    @property
    def root(self) -> Tensor:
        """Path of the first joint, (f, 3) metres."""
        return self.translations[:, 0]

    def index(self, name: str) -> int:
        """Index of a joint by name.

        Raises: ValueError naming the joint and those that exist.
        """
        if name not in self.names:
            raise ValueError(f"joint {name!r} is unknown; the file has {', '.join(self.names)}")
        return self.names.index(name)

    def frames(self, start: int, stop: int | None = None) -> "BVH":
        """The frames start..stop-1, as with a slice of a list.

        Raises: ValueError when no frame is left.
        """
        rotations = self.rotations[start:stop]
        if len(rotations) == 0:
            raise ValueError(f"frames({start}, {stop}) is empty; there are {self.num_frames}")
        return replace(self, rotations=rotations, translations=self.translations[start:stop])

    def world(self) -> tuple[Tensor, Tensor]:
        r"""Positions and rotations of all joints in the world.

        $$p_j = p_{p(j)} + Q_{p(j)}\, o_j,\quad Q_j = Q_{p(j)} R_j$$

        Shapes: -> (f, j, 3) metres, (f, j, 3, 3).
        """
        points: list = []
        Q: list = []
        local, move = self.rotations.unbind(1), self.translations.unbind(1)
        for j, p in enumerate(self.parents):
            if p < 0:
                points.append(move[j])
                Q.append(local[j])
            else:
                points.append(points[p] + (Q[p] @ move[j][..., None])[..., 0])
                Q.append(Q[p] @ local[j])
        return torch.stack(points, 1), torch.stack(Q, 1)

    def rest(self) -> Tensor:
        """Positions when no joint is turned, the first joint at the origin, (j, 3) metres."""
        points: list = []
        for offset, p in zip(self.offsets, self.parents, strict=True):
            points.append(points[p] + offset if p >= 0 else torch.zeros_like(offset))
        return torch.stack(points)


def read_bvh(path_or_text, *, fps: float | None = None, scale: float = CENTIMETRE) -> BVH:
    r"""Read a BVH file, or its text (a string of more than one line).

    Joints turn in the order in which their channels stand, $R = R_1 R_2 R_3$, in degrees; any order
    and any number of channels is read, position channels at every joint too (they then replace the
    offset). ``fps`` overrides a wrong header, ``scale`` is the length of the file's unit in metres.
    Nothing is allocated for frames that the file does not hold.

    Raises: ValueError naming the line, what stands there and what should; OSError for no such file.

    >>> text = '''HIERARCHY
    ... ROOT hip
    ... {
    ... OFFSET 0 0 0
    ... CHANNELS 4 Xposition Yposition Zposition Yrotation
    ... End Site
    ... {
    ... OFFSET 0 0 10
    ... }
    ... }
    ... MOTION
    ... Frames: 1
    ... Frame Time: 0.04
    ... 0 100 0 90'''
    >>> bvh = read_bvh(text)
    >>> bvh.names, bvh.fps, (bvh.world()[0][0] + 0.0).round(decimals=6).tolist()
    (('hip', 'hip_end'), 25.0, [[0.0, 1.0, 0.0], [0.1, 1.0, 0.0]])
    """
    if not (math.isfinite(scale) and scale > 0):
        raise ValueError(f"scale={scale} must be a positive number of metres per unit of the file")
    lines = _Lines(_text_of(path_or_text))
    tree = _read_tree(lines)
    rows, rate = _read_motion(lines, sum(len(channels) for _, _, _, channels in tree))
    rate = rate if fps is None else fps
    if not 1 <= rate <= MAX_FPS:  # nan too
        raise ValueError(f"frame rate {rate} is not in 1..{MAX_FPS:g}; pass the true one as fps=")
    offsets = torch.tensor([offset for _, _, offset, _ in tree], dtype=torch.float64) * scale
    rotations, translations = _split_channels(rows, [row[3] for row in tree], offsets, scale)
    names, parents = tuple(row[0] for row in tree), tuple(row[1] for row in tree)
    return BVH(names, parents, offsets, rotations, translations, float(rate))


class _Lines:
    """The lines of a file that hold something, one after another, with their numbers for errors."""

    def __init__(self, text: str):
        text = text.replace("{", "\n{\n").replace("}", "\n}\n")  # some writers put them in line
        self.rows = [row for line in text.splitlines() if (row := line.split())]
        self.at = -1

    def next(self, expected: str) -> list[str]:
        self.at += 1
        if self.at >= len(self.rows):
            raise ValueError(f"BVH ends where {expected} should stand; the file is cut off")
        return self.rows[self.at]

    def wrong(self, expected: str) -> ValueError:
        found = " ".join(self.rows[self.at])[:60]
        return ValueError(f"BVH has {found!r} (entry {self.at + 1}) where {expected} should stand")

    def numbers(self, words: list[str], expected: str) -> list[float]:
        try:
            values = [float(word) for word in words]
        except ValueError:
            raise self.wrong(expected) from None
        if not all(map(math.isfinite, values)):
            raise self.wrong(expected)
        return values


def _text_of(source) -> str:
    if isinstance(source, str) and ("\n" in source or not source.strip()):
        return source
    return Path(source).read_bytes().decode("utf-8-sig", errors="replace")


def _read_tree(lines: _Lines) -> list[tuple[str, int, list[float], list[str]]]:
    """Name, parent, offset and channels of each joint, in the order of the file."""
    if [word.upper() for word in lines.next("HIERARCHY")] != ["HIERARCHY"]:
        raise lines.wrong("HIERARCHY")
    tree: list = []
    open_joints: list[int] = []  # a stack instead of recursion: depth is the file's choice
    while not tree or open_joints:
        row = lines.next("a joint or }")
        word = row[0].upper()
        if word == "}" and open_joints:
            name, _, offset, _ = tree[open_joints.pop()]
            if not offset:
                raise lines.wrong(f"the OFFSET of {name!r}")
        elif word in ("ROOT", "JOINT", "END") and (word == "ROOT") == (not tree) and len(row) > 1:
            parent = open_joints[-1] if open_joints else -1
            name = tree[parent][0] + END if word == "END" else " ".join(row[1:])
            if lines.next("{") != ["{"]:
                raise lines.wrong("{")
            open_joints.append(len(tree))
            tree.append((name, parent, [], []))
        elif word == "OFFSET" and open_joints and len(row) == 4 and not tree[open_joints[-1]][2]:
            tree[open_joints[-1]][2].extend(lines.numbers(row[1:], "three numbers of an OFFSET"))
        elif word == "CHANNELS" and open_joints and not tree[open_joints[-1]][3]:
            tree[open_joints[-1]][3].extend(_channels(lines, row))
        else:
            raise lines.wrong("ROOT, JOINT, End Site, OFFSET x y z, CHANNELS or }")
    names = [row[0] for row in tree]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"BVH has two joints called {twice!r}; rename one")
    return tree


def _channels(lines: _Lines, row: list[str]) -> list[str]:
    channels = [word.lower() for word in row[2:]]
    known = set(channels) <= set(_CHANNELS) and len(set(channels)) == len(channels)
    if not known or row[1:2] != [str(len(channels))]:
        raise lines.wrong("CHANNELS, their number and as many different names")
    return channels


def _read_motion(lines: _Lines, width: int) -> tuple[np.ndarray, float]:
    """The numbers of all frames (f, width) and the header's frame rate."""
    if [word.upper() for word in lines.next("MOTION")] != ["MOTION"]:
        raise lines.wrong("MOTION")
    frames = _header(lines, "Frames:")
    seconds = _header(lines, "Frame Time:")
    words = [word for row in lines.rows[lines.at + 1 :] for word in row]
    # compared as numbers, before anything is made: a header may ask for 1e300 frames
    if frames < 1 or frames % 1 or width == 0 or frames * width != len(words):
        raise ValueError(
            f"BVH names {frames:g} frames of {width} channels but holds {len(words)} numbers; "
            "correct 'Frames:' or restore the missing lines"
        )
    try:
        rows = np.array(list(map(float, words))).reshape(-1, width)
    except ValueError as err:
        raise ValueError(f"BVH has something else than numbers in its frames: {err}") from None
    if not np.isfinite(rows).all() or np.abs(rows).max() > 1e9:
        raise ValueError("BVH has numbers in its frames that are not finite or beyond 1e9")
    return rows, 1 / seconds if seconds > 1e-9 else 0.0


def _header(lines: _Lines, name: str) -> float:
    head, colon, number = " ".join(lines.next(name)).partition(":")  # some write "Frames:1"
    if (head + colon).lower() != name.lower():
        raise lines.wrong(f"{name!r} and a number")
    return lines.numbers([number], f"{name!r} and a number")[0]


def _split_channels(rows: np.ndarray, channels: list[list[str]], offsets: Tensor, scale: float):
    """Rotations and translations of every joint from the columns of the file."""
    columns = torch.from_numpy(rows)
    f, j = len(rows), len(channels)
    rotations = torch.eye(3, dtype=torch.float64).repeat(f, j, 1, 1)
    translations = offsets.repeat(f, 1, 1)
    at = 0
    for k, names in enumerate(channels):
        for name in names:
            kind, axis = _CHANNELS[name]
            if kind == "position":
                translations[:, k, axis] = columns[:, at] * scale
            else:
                angle = torch.deg2rad(columns[:, at])
                rotations[:, k] = rotations[:, k] @ rotation_about("xyz"[axis], angle)
            at += 1
    return rotations, translations
