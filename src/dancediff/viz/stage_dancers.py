"""The bodies on the stage, and the tracks that move them.

Read first: `dancediff.motion.skeleton` · `dancediff.viz.solids` · `dancediff.viz.skin`.

Every joint is a mesh inside its parent's mesh, or an empty group where it has no surface. A dancer
is moved by one quaternion track a joint and one position track; all bodies share the same shapes.
Of body="mesh" joints are bones, and one skin beside them follows them all.
"""

import numpy as np

from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import SMPL24, Skeleton
from dancediff.viz.mannequin import SKULL, lighter, steady_quaternions
from dancediff.viz.palette import INK, dancer_color
from dancediff.viz.skin import body_skin
from dancediff.viz.solids import body_solids, capsule, egg, joined

BODIES = ("mannequin", "stick", "mesh")
SKIN = "skin"  # its name among the shapes
_BONE = 0.016  # metres, radius
_HEAD = 0.105


def make_shapes(p3, skeleton: Skeleton, body: str) -> dict:
    """The surface of every joint that has one, by the joint's name; "face" is of another colour.

    Raises: ValueError for an unknown body.
    """
    if body not in BODIES:
        raise ValueError(f"body={body!r} is unknown; choose from {', '.join(map(repr, BODIES))}")
    if body == "mesh":
        if skeleton.names != SMPL24.names:
            raise ValueError('body="mesh" fits SMPL-24; show this skeleton with body="stick"')
        return {SKIN: _skin_geometry(p3)}
    solids = body_solids() if body == "mannequin" else _sticks(skeleton)
    return {name: _geometry(p3, *solid) for name, solid in solids.items()}


def make_dancer(p3, motion: Motion, k: int, shapes: dict, number: int) -> list:
    """What dancer k is made of, in the first pose; ``number`` counts all on the stage."""
    skeleton, color = motion.skeleton, dancer_color(k)
    facts: dict = {"roughness": 0.75, "metalness": 0.0, "skinning": SKIN in shapes}
    paint = p3.MeshStandardMaterial(color=color, **facts)
    face = p3.MeshStandardMaterial(color=lighter(color), roughness=0.8, metalness=0.0)
    turns = steady_quaternions(motion.frames(0, 1))[k, 0].tolist()
    places = skeleton.offsets.double().numpy().tolist()
    places[0] = motion.root[k, 0].tolist()
    joints: list = [None] * skeleton.num_joints
    for j in reversed(range(skeleton.num_joints)):  # children come after their parents
        name = skeleton.names[j]
        inside = [joints[c] for c, parent in enumerate(skeleton.parents) if parent == j]
        if name == "head":
            inside.append(make_label(p3, str(k), (0.0, 0.38, 0.0), 0.25))
            inside += [p3.Mesh(shapes["face"], face)] if "face" in shapes else []
        facts = {"name": joint_name(number, j), "position": places[j], "quaternion": turns[j]}
        if name in shapes:
            joints[j] = p3.Mesh(shapes[name], paint, castShadow=True, children=inside, **facts)
        else:
            kind = p3.Bone if SKIN in shapes else p3.Group
            joints[j] = kind(children=inside, **facts)
    if SKIN not in shapes:
        return [joints[0]]
    skin = p3.SkinnedMesh(
        shapes[SKIN],
        paint,
        skeleton=p3.Skeleton(bones=joints),
        castShadow=True,
        frustumCulled=False,  # three.js does not know that the skin goes where the bones go
    )
    return [joints[0], skin]


def make_tracks(p3, motion: Motion, first: int = 0) -> list:
    """Tracks of all dancers, by a clock that counts frames; names count from ``first``."""
    times = np.arange(motion.num_frames, dtype=np.float32)
    quaternions = steady_quaternions(motion)
    tracks = []
    for k in range(motion.num_dancers):
        root = motion.root[k].numpy().astype(np.float32)
        name = joint_name(first + k, 0)
        tracks.append(p3.VectorKeyframeTrack(name=f"{name}.position", times=times, values=root))
        for j in range(motion.skeleton.num_joints):
            name, turns = joint_name(first + k, j), quaternions[k, :, j].copy()
            track = p3.QuaternionKeyframeTrack(name=f"{name}.quaternion", times=times, values=turns)
            tracks.append(track)
    return tracks


def joint_name(number: int, j: int) -> str:
    """How clip and scene call a joint.

    >>> joint_name(1, 4)
    'dancer1joint4'
    """
    return f"dancer{number}joint{j}"


def make_label(p3, text: str, place, size: float):
    """A word that always faces the camera, so that dancers differ by more than colour."""
    word = p3.TextTexture(string=text, color=INK, size=64, minFilter="LinearFilter")
    paint = p3.SpriteMaterial(map=word, transparent=True, depthTest=False)
    return p3.Sprite(paint, position=place, scale=(size, size, 1.0))


def _sticks(skeleton: Skeleton) -> dict:
    """A thin bone from every joint to each of its children, and a ball for the head."""
    offsets, names = skeleton.offsets.double().numpy(), skeleton.names
    bones: dict[str, list] = {}
    for child, parent in enumerate(skeleton.parents):
        if parent >= 0 and np.linalg.norm(offsets[child]) > 1e-6:
            bone = capsule(np.zeros(3), offsets[child], _BONE, _BONE)
            bones.setdefault(names[parent], []).extend(bone)
    if "head" in names:
        bones.setdefault("head", []).append(egg(SKULL, [_HEAD] * 3))
    return {name: joined(parts) for name, parts in bones.items()}


def _skin_geometry(p3):
    skin = body_skin()
    parts = {
        "position": skin.points,
        "normal": skin.normals,
        "skinIndex": skin.joints.astype(np.float32),  # the shader reads whole numbers as 0
        "skinWeight": skin.weights,
    }
    return p3.BufferGeometry(
        attributes={name: p3.BufferAttribute(array) for name, array in parts.items()},
        index=p3.BufferAttribute(skin.triangles.ravel()),
    )


def _geometry(p3, points, normals, triangles):
    return p3.BufferGeometry(
        attributes={"position": p3.BufferAttribute(points), "normal": p3.BufferAttribute(normals)},
        index=p3.BufferAttribute(triangles.ravel()),
    )
