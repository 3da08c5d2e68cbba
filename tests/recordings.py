"""One real take, written as other motion capture programs would: for tests of readers."""

from dataclasses import dataclass, replace
from pathlib import Path

import torch

from dancediff.data.bvh import BVH, END
from dancediff.data.folder.tree import tree_from_world
from dancediff.data.retarget import resample
from dancediff.motion.rotation import axis_angle_to_matrix, rotation_about

PARTS = ("root", "belly", "spine", "neck", "head")
LIMBS = ("collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")


@dataclass(frozen=True)
class Convention:
    """How a program names joints, which way is up, its unit, its frame rate, its rest pose."""

    middle: tuple[str, ...]  # root, belly, spine, neck, head
    limbs: tuple[str, ...]  # collar ... ankle, with % for the side
    sides: tuple[str, str]
    up: str = "y"
    unit: float = 0.01
    fps: float = 60.0
    rest: str = "kept"  # or "crooked": no body at all, but the first frame is a T-pose
    moved: bool = False  # a place for every joint in every frame


def _words(text: str) -> tuple[str, ...]:
    return tuple(text.split())


CMU = {
    **dict(zip(PARTS, _words("hip abdomen chest neck head"), strict=True)),
    **{
        side + ours: side + theirs
        for side in "lr"
        for ours, theirs in zip(
            LIMBS, _words("Collar Shldr ForeArm Hand Thigh Shin Foot"), strict=True
        )
    },
}
MIXAMO = Convention(
    _words("mixamorig:Hips mixamorig:Spine mixamorig:Spine1 mixamorig:Neck mixamorig:Head"),
    tuple(f"mixamorig:%{part}" for part in _words("Shoulder Arm ForeArm Hand UpLeg Leg Foot")),
    ("Left", "Right"),
)
ROKOKO = Convention(
    _words("Hips Spine1 Spine2 Neck Head"),
    _words("%Shoulder %Arm %ForeArm %Hand %Thigh %Shin %Foot"),
    ("Left", "Right"),
    fps=100.0,
    moved=True,
)
BLENDER = Convention(
    _words("spine spine.001 spine.002 spine.004 spine.006"),
    _words("shoulder.% upper_arm.% forearm.% hand.% thigh.% shin.% foot.%"),
    ("L", "R"),
    up="z",
    unit=1.0,
    fps=24.0,
)
ASF = Convention(
    _words("Hips LowerBack Spine Neck Head"),
    _words("%Shoulder %Arm %ForeArm %Hand %UpLeg %Leg %Foot"),
    ("Left", "Right"),
    unit=0.0254 / 0.45,
    fps=120.0,
    rest="crooked",
)
UNNAMED = Convention(
    _words("Bone_0 Bone_1 Bone_2 Bone_3 Bone_4"),
    _words("Bone_%1 Bone_%2 Bone_%3 Bone_%4 Bone_%5 Bone_%6 Bone_%7"),
    ("5", "6"),
    up="z",
    unit=0.001,
    fps=50.0,
)
DAZ = Convention(
    _words("hip abdomen chest neck head"),
    _words("%Collar %Shldr %ForeArm %Hand %Thigh %Shin %Foot"),
    ("l", "r"),
)


def in_convention(bvh: BVH, convention: Convention) -> BVH:
    """A take of the CMU skeleton in another convention; its length unit is that of the file."""
    names, c = _renamed(bvh, convention), convention
    bvh = resample(replace(bvh, names=names), c.fps) if bvh.fps != c.fps else bvh
    if c.rest == "crooked":
        stand = torch.eye(3).double().expand(1, len(names), 3, 3)
        place = torch.cat([bvh.translations[:1, :1], bvh.offsets[None, 1:]], dim=1)
        bvh = replace(
            bvh,
            rotations=torch.cat([stand, bvh.rotations]),
            translations=torch.cat([place, bvh.translations]),
        )
    turn = rotation_about("x", torch.tensor(torch.pi / 2).double()) if c.up == "z" else torch.eye(3)
    points, Q = bvh.world()
    points, Q = points @ turn.double().T, turn.double() @ Q @ turn.double().T
    rest_points = bvh.rest() @ turn.double().T
    rest = torch.eye(3).double().expand(len(names), 3, 3)
    if c.rest == "crooked":  # every bone along one axis, in joints that are turned anyhow
        draw = torch.Generator().manual_seed(5)
        twist = axis_angle_to_matrix(torch.randn(len(names), 3, generator=draw).double() * 2)
        local = replace(bvh, rotations=twist[None], translations=bvh.offsets[None])
        rest_points, rest = (x[0] for x in local.world())
    # the pose that is called the rest is no pose of the take: joints move from it as they moved
    written = tree_from_world(names, bvh.parents, (points, Q), (rest_points, rest), c.fps)
    return replace(
        written, offsets=written.offsets / c.unit, translations=written.translations / c.unit
    )


def _renamed(bvh: BVH, c: Convention) -> tuple[str, ...]:
    new = {CMU[ours]: theirs for ours, theirs in zip(PARTS, c.middle, strict=True)}
    for side, word in zip("lr", c.sides, strict=True):
        for ours, theirs in zip(LIMBS, c.limbs, strict=True):
            new[CMU[side + ours]] = theirs.replace("%", word)
    names = []
    for k, name in enumerate(bvh.names):
        base = name.removesuffix(END)
        names.append(new.get(base, f"extra{k}" if name == base else base) + name[len(base) :])
    parents = bvh.parents  # an End Site is called after its joint
    return tuple(
        names[parents[k]] + END if name.endswith(END) else name for k, name in enumerate(names)
    )


def write_bvh(path: Path, bvh: BVH, *, moved: bool = False) -> Path:
    """A BVH file with rotations Z Y X; ``moved`` writes the place of every joint, too."""
    lines, order = ["HIERARCHY"], []

    def write(j: int, depth: int) -> None:
        pad, below = "  " * depth, [k for k, p in enumerate(bvh.parents) if p == j]
        offset = "OFFSET " + " ".join(f"{x:.6f}" for x in bvh.offsets[j].tolist())
        end = bvh.names[j].endswith(END)
        kind = "End Site" if end else f"{'JOINT' if depth else 'ROOT'} {bvh.names[j]}"
        lines.extend([pad + kind, pad + "{", f"{pad}  {offset}"])
        if not end:
            place = "Xposition Yposition Zposition " if moved or depth == 0 else ""
            count = 6 if place else 3
            lines.append(f"{pad}  CHANNELS {count} {place}Zrotation Yrotation Xrotation")
            order.append((j, bool(place)))
        for k in below:
            write(k, depth + 1)
        lines.append(pad + "}")

    write(0, 0)
    columns = []
    for j, place in order:
        R = bvh.rotations[:, j]
        y = torch.asin(-R[:, 2, 0].clamp(-1, 1))
        z, x = torch.atan2(R[:, 1, 0], R[:, 0, 0]), torch.atan2(R[:, 2, 1], R[:, 2, 2])
        angles = torch.rad2deg(torch.stack([z, y, x], 1))
        columns += [bvh.translations[:, j], angles] if place else [angles]
    lines += ["MOTION", f"Frames: {bvh.num_frames}", f"Frame Time: {1 / bvh.fps:.7f}"]
    lines += [" ".join(f"{x:.5f}" for x in row) for row in torch.cat(columns, 1).tolist()]
    path.write_text("\n".join(lines) + "\n")
    return path
