"""Which joint of a recording plays which joint of SMPL-24, for the common skeletons.

A map is a dict from SMPL-24 names to names in the file. Three are known by name: "cmu" (the BVH
conversion of the CMU database for Daz figures), "mixamo", and "generic", which tries the names that
most other programs write. An End Site is called after its joint, with "_end" behind.
"""

import re
from collections.abc import Iterable
from itertools import pairwise

from dancediff.motion.skeleton import SMPL24

NEEDED = ("root", "neck", "head", *(f"{side}{part}" for side in "lr" for part in (
    "hip", "knee", "ankle", "shoulder", "elbow", "wrist")))  # fmt: skip
CHAINS = (  # joints of one line; what is not mapped is passed over
    ("belly", "spine", "chest", "neck", "head"),
    *((f"{side}hip", f"{side}knee", f"{side}ankle", f"{side}toe") for side in "lr"),
    *((f"{side}shoulder", f"{side}elbow", f"{side}wrist", f"{side}hand") for side in "lr"),
)
GIRDLES = (("rhip", "lhip"), ("rshoulder", "lshoulder"))


def _both(spine: dict[str, str], side: dict[str, str], left: str, right: str) -> dict[str, str]:
    """A map from one for the middle and one for the sides, in which # is left or right."""
    sides = {"l": left, "r": right}
    return spine | {
        k + j: v.replace("#", name) for k, name in sides.items() for j, v in side.items()
    }


_CMU = _both(
    {"root": "hip", "belly": "abdomen", "spine": "chest", "neck": "neck", "head": "head"},
    {
        **{"hip": "#Thigh", "knee": "#Shin", "ankle": "#Foot", "toe": "#Foot_end"},
        **{"collar": "#Collar", "shoulder": "#Shldr", "elbow": "#ForeArm", "wrist": "#Hand"},
        "hand": "#Mid1",
    },
    *("l", "r"),
)
_MIXAMO = _both(
    {
        **{"root": "Hips", "belly": "Spine", "spine": "Spine1", "chest": "Spine2"},
        **{"neck": "Neck", "head": "Head"},
    },
    {
        **{"hip": "#UpLeg", "knee": "#Leg", "ankle": "#Foot", "toe": "#ToeBase"},
        **{"collar": "#Shoulder", "shoulder": "#Arm", "elbow": "#ForeArm", "wrist": "#Hand"},
        "hand": "#HandMiddle1",
    },
    *("Left", "Right"),
)
# the first name that the file has and that no earlier joint has taken, letters only
_GENERIC = {
    "root": "root hips hip pelvis",
    "belly": "belly spine abdomen spinea lowerback spine0",
    "chest": "chest spine2 spine3 upperchest thorax",
    "spine": "spine spine1 spine2 chest",
    "neck": "neck neck1",
    "head": "head",
    "#shoulder": "%shoulder #arm #upperarm #uparm #shldr #shoulder",
    "#elbow": "%elbow #forearm #lowerarm #lowarm #elbow",
    "#wrist": "%wrist #hand #wrist",
    "#collar": "%collar #collar #clavicle #shoulder",
    "#hand": "%hand #handmiddle1 #middle1 #handend #wristend",
    "#hip": "%hip #upleg #thigh #upperleg #hip",
    "#knee": "%knee #leg #shin #calf #lowleg #lowerleg #knee",
    "#ankle": "%ankle #foot #ankle",
    "#toe": "%toe #toebase #toe #ball #footend #ankleend",
}
MAPS = ("cmu", "mixamo", "generic")


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
    for name in names:
        bare.setdefault(_bare(name), name)
    if which != "generic":
        wanted = _CMU if which == "cmu" else _MIXAMO
        return {ours: bare[_bare(name)] for ours, name in wanted.items() if _bare(name) in bare}
    found: dict[str, str] = {}
    for ours, options in _GENERIC.items():
        for k, side in (("l", "left"), ("r", "right")) if "#" in ours else (("", ""),):
            # SMPL's own short names first ("lhip"); others may write left, l or _l
            tries = [
                word.replace("%", k).replace("#", mark)
                for word in options.split()
                for mark in ((side, k) if "#" in word else ("",))
            ]
            tries += [word[1:] + k for word in options.split() if word[0] == "#"]
            left = (bare[t] for t in tries if t in bare and bare[t] not in found.values())
            if first := next(left, None):
                found[ours.replace("#", k)] = first
    return found


def _bare(name: str) -> str:
    """Small letters and numbers only, without what stands before a colon, or Bip01."""
    name = name.rpartition(":")[2].lower().removeprefix("bip01")
    return re.sub(r"0+(?=\d)", "", "".join(letter for letter in name if letter.isalnum()))
