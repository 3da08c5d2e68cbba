r"""Which joint is which, from how a tree of joints branches, when the names tell nothing.

Read first: `dancediff.data.joint_maps`, the skeletons whose names are known.

A body has a joint with two legs and a spine, and on the spine one with two arms and a neck. Legs
and arms come in pairs of equal lengths; upper and lower leg are the two longest bones in a row. The
toes point to the front, and so tell left from right; names with a side in them decide before that.

Symbols (axes: j joints)
    points   positions in an upright pose, y up   (j, 3)
"""

import re
from itertools import pairwise

import torch
from torch import Tensor

from dancediff.data.bvh import BVH, END

PAIR = 0.15  # by which share of their length two limbs of a pair may differ
_LEFT = re.compile(r"(^|[^a-z])(l|left)([^a-z]|$)|^left|left$")
_RIGHT = re.compile(r"(^|[^a-z])(r|right)([^a-z]|$)|^right|right$")


def guess_joints(bvh: BVH, points: Tensor) -> dict[str, str]:
    """SMPL-24 names to names of the file, for a body that stands somehow upright in ``points``.

    Joints of the spine are left out: they follow from root and neck.

    Raises: ValueError telling which part of a body the tree does not have.
    """
    tree = _Tree(bvh, points)
    hips, (leg, other), spine = tree.hips()
    arm, second, neck = tree.chest(spine)
    found = {"root": hips, **tree.neck(neck)}
    up = points[found["neck"]] - points[hips]
    legs = [tree.leg(leg), tree.leg(other)]
    front = sum(points[limb[-1]] - points[limb[2]] for limb in legs)
    left = torch.linalg.cross(up, front)  # type: ignore[arg-type]
    for kind, limbs in (("leg", legs), ("arm", [tree.arm(arm), tree.arm(second)])):
        for side, limb in zip("lr", tree.left_first(limbs, left), strict=True):
            parts = _LEG if kind == "leg" else _ARM[-len(limb) :]
            found |= {side + part: j for part, j in zip(parts, limb, strict=False)}
    return {ours: bvh.names[j] for ours, j in found.items()}


_LEG = ("hip", "knee", "ankle", "toe")
_ARM = ("collar", "shoulder", "elbow", "wrist")


class _Tree:
    """The branches of a recording's joints."""

    def __init__(self, bvh: BVH, points: Tensor):
        self.names, self.parents, self.points = bvh.names, bvh.parents, points
        self.children: list[list[int]] = [[] for _ in bvh.names]
        for j, p in enumerate(bvh.parents):
            if p >= 0:
                self.children[p].append(j)
        self.size = [1] * len(bvh.names)  # of the branch from here on
        for j in reversed(range(1, len(bvh.names))):
            self.size[bvh.parents[j]] += self.size[j]

    def longest(self, start: int) -> list[int]:
        """The longest line from a joint on, in metres."""
        best = max((self.longest(c) for c in self.children[start]), key=self.length, default=[])
        return [start, *best]

    def length(self, line: list[int]) -> float:
        """Length of a line with the bone before it, metres."""
        row = [self.parents[line[0]], *line] if line else []
        return sum((self.points[a] - self.points[b]).norm().item() for a, b in pairwise(row))

    def bone(self, j: int) -> float:
        """Length of the bone to a joint from its parent."""
        return (self.points[j] - self.points[self.parents[j]]).norm().item()

    def pair(self, branches: list[int]) -> tuple[int, int] | None:
        """The two longest branches of at least three joints and equal lengths."""
        lines = {j: self.longest(j) for j in branches}
        long = [j for j in branches if len(lines[j]) >= 3]
        best: tuple[float, tuple[int, int] | None] = (0.0, None)
        for k, a in enumerate(long):
            for b in long[k + 1 :]:
                x, y = self.length(lines[a]), self.length(lines[b])
                if abs(x - y) < PAIR * max(x, y) and x + y > best[0]:
                    best = (x + y, (a, b))
        return best[1]

    def hips(self) -> tuple[int, tuple[int, int], int]:
        """The joint with two legs and a spine, the first joints of the legs, and of the spine."""
        for j in range(len(self.names)):  # parents first
            rest = self.children[j]
            if len(rest) >= 3:
                spine = max(rest, key=lambda c: self.size[c] if self._bears_arms(c) else 0)
                legs = self.pair([c for c in rest if c != spine])
                if legs and self._bears_arms(spine):
                    return j, legs, spine
        raise ValueError("no joint has two legs and a spine with two arms below it")

    def _bears_arms(self, start: int) -> bool:
        return self._chest(start) is not None

    def _chest(self, start: int) -> tuple[int, int, int] | None:
        for j in range(start, len(self.names)):
            if j != start and start not in self._above(j):
                continue
            rest = self.children[j]
            arms = self.pair(rest) if len(rest) >= 3 else None
            if arms:
                neck = max((c for c in rest if c not in arms), key=lambda c: self.size[c])
                return *arms, neck
        return None

    def chest(self, spine: int) -> tuple[int, int, int]:
        """The first joints of both arms and of the neck."""
        found = self._chest(spine)
        if found is None:
            raise ValueError("no joint of the spine has two arms and a neck")
        return found

    def _above(self, j: int) -> list[int]:
        row = []
        while self.parents[j] >= 0:
            j = self.parents[j]
            row.append(j)
        return row

    def neck(self, start: int) -> dict[str, int]:
        """Neck and head."""
        row = self.longest(start)
        if len(row) < 2:
            raise ValueError(f"{self.names[start]!r} is neck and head in one; a neck needs a head")
        head = next(j for j in row[1:] if self._ends(j))
        return {"neck": row[0], "head": head}

    def _ends(self, j: int) -> bool:
        """Does a line of bones end here, or part into eyes and jaw?"""
        below = self.children[j]
        return len(below) != 1 or self.names[below[0]].endswith(END)

    def leg(self, start: int) -> list[int]:
        """Hip, knee, ankle and a toe."""
        row = self.longest(start)
        k = self._two_long_bones(row)
        if len(row) < k + 4:
            raise ValueError(f"the leg from {self.names[start]!r} has no joint behind the ankle")
        return row[k : k + 4]

    def arm(self, start: int) -> list[int]:
        """Collar if there is one, shoulder, elbow, wrist."""
        row = self.longest(start)
        k = self._two_long_bones(row)
        return row[max(k - 1, 0) : k + 3]

    def _two_long_bones(self, row: list[int]) -> int:
        """Where in a line the two bones begin of which the shorter is longest."""
        if len(row) < 3:
            raise ValueError(f"the limb from {self.names[row[0]]!r} has fewer than three joints")
        bones = [self.bone(j) for j in row[1:]]
        return max(range(len(bones) - 1), key=lambda k: min(bones[k], bones[k + 1]))

    def left_first(self, limbs: list[list[int]], left: Tensor) -> list[list[int]]:
        """The two limbs of a pair, the left one first."""
        told = [side_of(self.names[limb[1]]) for limb in limbs]
        if sorted(filter(None, told)) == ["l", "r"]:
            return limbs if told[0] == "l" else limbs[::-1]
        across = self.points[limbs[0][1]] - self.points[limbs[1][1]]
        return limbs if (across * left).sum() > 0 else limbs[::-1]


def longest_branch(bvh: BVH, name: str) -> str | None:
    """The child of a joint whose branch reaches farthest, such as the middle finger of a hand."""
    tree = _Tree(bvh, bvh.rest())
    below = tree.children[bvh.index(name)]
    best = max(below, key=lambda j: tree.length(tree.longest(j)), default=None)
    return None if best is None else bvh.names[best]


def side_of(name: str) -> str:
    """The side that a name tells: "l", "r" or nothing.

    >>> [side_of(name) for name in ("LeftUpLeg", "shin.R", "Bip01 L Calf", "Lower", "Bone_7")]
    ['l', 'r', 'l', '', '']
    """
    words = re.sub(r"([a-z])([A-Z])", r"\1_\2", name).lower()
    return "l" if _LEFT.search(words) else "r" if _RIGHT.search(words) else ""
