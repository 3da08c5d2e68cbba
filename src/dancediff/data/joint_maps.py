"""Which joint of a recording plays which joint of SMPL-24, for the common skeletons.

A map is a dict from SMPL-24 names to names in the file. Three are known by name and written down in
``joint_maps.toml``: "cmu" (the BVH conversion of the CMU database for Daz figures), "mixamo", and
"generic", which tries the names that most other programs write. An End Site is called after its
joint, with "_end" behind.
"""

import re
import tomllib
from collections.abc import Iterable
from itertools import pairwise
from os.path import commonprefix
from pathlib import Path

from dancediff.motion.skeleton import SMPL24

NEEDED = ("root", "neck", "head", *(f"{side}{part}" for side in "lr" for part in (
    "hip", "knee", "ankle", "shoulder", "elbow", "wrist")))  # fmt: skip
CHAINS = (  # joints of one line; what is not mapped is passed over
    ("belly", "spine", "chest", "neck", "head"),
    *((f"{side}hip", f"{side}knee", f"{side}ankle", f"{side}toe") for side in "lr"),
    *((f"{side}shoulder", f"{side}elbow", f"{side}wrist", f"{side}hand") for side in "lr"),
)
GIRDLES = (("rhip", "lhip"), ("rshoulder", "lshoulder"))


MAPS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def find_joints(names: Iterable[str], joints: str | dict[str, str] = "generic") -> dict[str, str]:
    """The map of a recording with these joint names, without what the recording lacks.

    ``joints`` is "cmu", "mixamo", "generic" or a map; prefixes such as "mixamorig:" do not matter.

    Raises: ValueError naming the joints that are needed and not found.

    >>> find_joints(SMPL24.names)["lelbow"]
    'lelbow'
    >>> find_joints([n for n in SMPL24.names if n != "neck"])  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ValueError: map 'generic' finds no neck among root, ...; pass joints={'neck': name in the file}
    """
    names = list(names)
    if isinstance(joints, dict):
        label, found = "joints", {ours: name for ours, name in joints.items() if name in names}
        unknown = [ours for ours in joints if ours not in SMPL24.names]
        if unknown:
            raise ValueError(f"joints maps {unknown[0]!r}, which is none of {SMPL24.names}")
    elif joints in MAPS:
        label, found = f"map {joints!r}", _named(names, joints)
    else:
        raise ValueError(f"joints={joints!r} is no map; use one of {', '.join(MAPS)} or a dict")
    missing = [ours for ours in NEEDED if ours not in found]
    if missing:
        raise ValueError(
            f"{label} finds no {', '.join(missing)} among {', '.join(names)}; "
            f"pass joints={{{missing[0]!r}: name in the file}}"
        )
    return found


def bones(mapped: Iterable[str]) -> list[tuple[str, str]]:
    """The bones whose direction two skeletons share: limbs, spine, the lines through both hips and
    both shoulders, each between joints that are mapped.

    >>> bones(["lhip", "lknee", "rhip", "belly"])
    [('lhip', 'lknee'), ('rhip', 'lhip')]
    """
    chains = [[j for j in chain if j in mapped] for chain in CHAINS]
    pairs = [pair for chain in chains for pair in pairwise(chain)]
    return pairs + [(a, b) for a, b in GIRDLES if a in mapped and b in mapped]


def _named(names: list[str], which: str) -> dict[str, str]:
    bare: dict[str, str] = {}
    shared = len(commonprefix(names))  # noqa: RUF071  names such as "dancer 1 lhip", no paths
    for name in names:
        bare.setdefault(_bare(name[shared:]), name)
    found: dict[str, str] = {}
    for ours, options in MAPS[which].items():
        for k, side in (("l", "left"), ("r", "right")) if "#" in ours else (("", ""),):
            # SMPL's own short names first ("lhip"); others may write left, l or _l
            tries = [
                word.replace("%", k).replace("#", mark)
                for word in options.split()
                for mark in ((side, k) if "#" in word else ("",))
            ]
            tries += [
                word[1:] + mark for word in options.split() if word[0] == "#" for mark in (k, side)
            ]
            left = (
                bare[name] for name in tries if name in bare and bare[name] not in found.values()
            )
            if first := next(left, None):
                found[ours.replace("#", k)] = first
    return found


def _bare(name: str) -> str:
    """Small letters and numbers only, without what stands before a colon, or Bip01."""
    name = name.rpartition(":")[2].lower().removeprefix("bip01")
    return re.sub(r"0+(?=\d)", "", "".join(letter for letter in name if letter.isalnum()))
