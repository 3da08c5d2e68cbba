r"""glTF 2.0 (.glb): dancers with bodies that move, for 3-D programs and the web; and back.

Read first: `dancediff.viz.solids` and `dancediff.viz.skin`.

Each dancer is a tree of 24 nodes, ``dancer 1 root`` ... ``dancer 1 rhand``, that carry rigid body
parts, or move the skin of ``dancer 1 body``; one animation turns them all. glTF has metres, y up
and quaternions (x, y, z, w), as we do.
"""

import struct
from pathlib import Path

import numpy as np
import roma
import torch

from dancediff import __version__
from dancediff.atomic import atomic_write
from dancediff.data.folder.gltf import OWN_FORMAT as FORMAT
from dancediff.data.folder.gltf import chunks
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import SMPL24, Skeleton
from dancediff.viz.mannequin import lighter, steady_quaternions
from dancediff.viz.palette import dancer_color
from dancediff.viz.skin import body_skin, rest_joints
from dancediff.viz.solids import body_solids

FLOAT, UINT16 = 5126, 5123
VERTICES, TRIANGLES = 34962, 34963  # what a buffer view is for
BODIES = ("mannequin", "mesh")
_BROKEN = (  # what a damaged file may end in
    ValueError, LookupError, TypeError, AttributeError, RecursionError, OverflowError, struct.error,
)  # fmt: skip
_KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def save_glb(motion: Motion, path, *, body: str = "mannequin") -> Path:
    """Write a dance as one .glb file: bodies, colours, one animation of all dancers.

    The file appears whole or not at all. `load_glb` gives it back; contacts are not kept.
    ``body`` is "mannequin", rigid parts, or "mesh", one skin a dancer that bends with the joints.

    Raises: ImportError naming the extra when pygltflib is not installed; ValueError for another
    skeleton than SMPL-24 or an unknown body.
    """
    if body not in BODIES:
        raise ValueError(f"body={body!r} is unknown in a .glb; choose from {', '.join(BODIES)}")
    if motion.skeleton.names != SMPL24.names:
        raise ValueError(
            f"a .glb shows SMPL-24 bodies; this skeleton has {motion.skeleton.num_joints} joints"
        )
    path, file = Path(path), _File()
    solids = body_solids() if body == "mannequin" else {}
    parts = {joint: file.solid(*arrays) for joint, arrays in solids.items()}  # all share them
    roots = [_dancer(file, motion, k, parts) for k in range(motion.num_dancers)]
    _animate(file, motion, roots)
    skins = _dress(file, roots) if body == "mesh" else []
    extras = {"format": FORMAT, "dancers": motion.num_dancers, "fps": motion.fps}
    extras["synthetic"] = motion.is_synthetic  # `prepare folder` must not take it for real
    content = file.finish(roots + skins, extras)
    with atomic_write(path) as part:
        part.write_bytes(content)
    return path


def load_glb(path) -> Motion:
    """Read a .glb that `save_glb` wrote.

    Raises: FileNotFoundError, or ValueError naming the file when it is another one or damaged.
    """
    path = Path(path)
    content = path.read_bytes()
    try:
        book, blob = chunks(content)
        extras = book["asset"].get("extras", {})
        if extras.get("format") != FORMAT:
            raise ValueError(f"format is {extras.get('format')!r}, not {FORMAT!r}")
        return _read(book, blob, extras)
    except _BROKEN as err:
        what = f"{type(err).__name__}: {err}"
        raise ValueError(f"{path} is no .glb written by Motion.save ({what})") from err


def _library():
    try:
        import pygltflib
    except ImportError as err:
        raise ImportError('.glb needs pygltflib: pip install "dancediff[gltf]"') from err
    return pygltflib


class _File:
    """A glTF document while it is put together: things get numbers, arrays get bytes."""

    def __init__(self):
        self.gltf = _library()
        self.book = self.gltf.GLTF2()
        self.bytes = bytearray()

    def array(self, x: np.ndarray, *, target: int | None = None, limits: bool = False) -> int:
        """Append an array (k,) or (k, c); returns the number of its accessor."""
        self.bytes += b"\0" * (-len(self.bytes) % 4)
        view = self.gltf.BufferView(
            buffer=0, byteOffset=len(self.bytes), byteLength=x.nbytes, target=target
        )
        self.bytes += np.ascontiguousarray(x).tobytes()
        self.book.bufferViews.append(view)
        accessor = self.gltf.Accessor(
            bufferView=len(self.book.bufferViews) - 1,
            componentType=UINT16 if x.dtype == np.uint16 else FLOAT,
            count=len(x),
            type=_KINDS[x.shape[1] if x.ndim > 1 else 1],
        )
        if limits:
            columns = x.reshape(len(x), -1)
            accessor.min, accessor.max = columns.min(0).tolist(), columns.max(0).tolist()
        self.book.accessors.append(accessor)
        return len(self.book.accessors) - 1

    def solid(self, points, normals, triangles):
        """Append a part of a body; returns (attributes, accessor of its triangles)."""
        where = self.array(points, target=VERTICES, limits=True)
        attributes = self.gltf.Attributes(
            POSITION=where, NORMAL=self.array(normals, target=VERTICES)
        )
        return attributes, self.array(triangles.ravel(), target=TRIANGLES)

    def paint(self, name: str, color: str) -> int:
        """A matte material; returns its number."""
        surface = self.gltf.PbrMetallicRoughness(
            baseColorFactor=[*_linear(color), 1.0], metallicFactor=0.0, roughnessFactor=0.8
        )
        self.book.materials.append(self.gltf.Material(name=name, pbrMetallicRoughness=surface))
        return len(self.book.materials) - 1

    def mesh(self, name: str, painted: list) -> int:
        """Solids, each with a material, as one mesh; returns its number."""
        primitives = [
            self.gltf.Primitive(attributes=attributes, indices=triangles, material=material)
            for (attributes, triangles), material in painted
        ]
        self.book.meshes.append(self.gltf.Mesh(name=name, primitives=primitives))
        return len(self.book.meshes) - 1

    def finish(self, roots: list[int], extras: dict) -> bytes:
        """The document as the bytes of a .glb file."""
        self.book.asset = self.gltf.Asset(
            version="2.0", generator=f"dancediff {__version__}", extras=extras
        )
        self.book.scenes, self.book.scene = [self.gltf.Scene(name="stage", nodes=roots)], 0
        self.book.buffers = [self.gltf.Buffer(byteLength=len(self.bytes))]
        self.book.set_binary_blob(bytes(self.bytes))
        return b"".join(self.book.save_to_bytes())


def _dancer(file: _File, motion: Motion, k: int, parts: dict) -> int:
    """The nodes of one dancer, standing as in the first frame; returns the root's number."""
    color, name = dancer_color(k), f"dancer {k + 1}"
    skin, face = None, None
    if parts:
        skin, face = file.paint(name, color), file.paint(f"{name} face", lighter(color))
    start = steady_quaternions(motion.frames(0, 1))[k, 0]
    first = len(file.book.nodes)
    for j, joint in enumerate(SMPL24.names):
        painted = [(parts[joint], skin)] if joint in parts else []
        if joint == "head" and parts:
            painted.append((parts["face"], face))
        place = motion.root[k, 0] if j == 0 else motion.skeleton.offsets[j]
        node = file.gltf.Node(
            name=f"{name} {joint}", translation=place.tolist(), rotation=start[j].tolist()
        )
        children = [first + c for c, p in enumerate(SMPL24.parents) if p == j]
        if children:
            node.children = children
        if painted:
            node.mesh = file.mesh(node.name, painted)
        file.book.nodes.append(node)
    return first


def _dress(file: _File, roots: list[int]) -> list[int]:
    """A skin for every dancer, moved by the joints' nodes; returns the numbers of its nodes.

    They stand beside the dancers and not in them: glTF places a skin by its joints alone.
    """
    body, gltf = body_skin(), file.gltf
    attributes, triangles = file.solid(body.points, body.normals, body.triangles)
    attributes.JOINTS_0 = file.array(body.joints, target=VERTICES)
    attributes.WEIGHTS_0 = file.array(body.weights, target=VERTICES)
    unbind = np.tile(np.eye(4, dtype=np.float32), (SMPL24.num_joints, 1, 1))
    unbind[:, 3, :3] = -rest_joints()  # columns lie one after the other
    matrices = file.array(unbind.reshape(-1, 16))
    dressed = []
    for k, root in enumerate(roots):
        name = f"dancer {k + 1}"
        joints = list(range(root, root + SMPL24.num_joints))
        file.book.skins.append(
            gltf.Skin(name=name, joints=joints, skeleton=root, inverseBindMatrices=matrices)
        )
        paint = file.paint(name, dancer_color(k))
        mesh = file.mesh(f"{name} body", [((attributes, triangles), paint)])
        file.book.nodes.append(gltf.Node(name=f"{name} body", mesh=mesh, skin=k))
        dressed.append(len(file.book.nodes) - 1)
    return dressed


def _animate(file: _File, motion: Motion, roots: list[int]) -> None:
    """One animation: the path of every root, the rotation of every joint."""
    gltf, times = file.gltf, np.arange(motion.num_frames, dtype=np.float32) / motion.fps
    clock = file.array(times.astype(np.float32), limits=True)
    dance = gltf.Animation(name="dance")

    def follow(node: int, what: str, values: np.ndarray) -> None:
        sampler = gltf.AnimationSampler(
            input=clock, output=file.array(values), interpolation="LINEAR"
        )
        dance.samplers.append(sampler)
        target = gltf.AnimationChannelTarget(node=node, path=what)
        dance.channels.append(gltf.AnimationChannel(sampler=len(dance.samplers) - 1, target=target))

    turns = steady_quaternions(motion)
    for k, root in enumerate(roots):
        follow(root, "translation", motion.root[k].numpy().astype(np.float32))
        for j in range(SMPL24.num_joints):
            follow(root + j, "rotation", np.ascontiguousarray(turns[k, :, j]))
    file.book.animations.append(dance)


def _read(book: dict, blob: bytes, extras: dict) -> Motion:
    n, fps = int(extras["dancers"]), float(extras["fps"])
    dance = book["animations"][0]
    found = {}
    for channel in dance["channels"]:
        name = book["nodes"][channel["target"]["node"]]["name"]
        output = dance["samplers"][channel["sampler"]]["output"]
        found[name, channel["target"]["path"]] = _values(book, blob, output)
    root = [found[f"dancer {k + 1} root", "translation"] for k in range(n)]
    turns = [
        np.stack([found[f"dancer {k + 1} {joint}", "rotation"] for joint in SMPL24.names], axis=1)
        for k in range(n)
    ]
    q = torch.nn.functional.normalize(torch.from_numpy(np.stack(turns)), dim=-1)
    meta: dict = {"source": "glb"}
    if extras.get("synthetic") is True:
        meta["synthetic"] = True
    pose, paths = roma.unitquat_to_rotmat(q), torch.from_numpy(np.stack(root))
    return Motion(pose, paths, fps, skeleton=_skeleton(book), meta=meta)


def _skeleton(book: dict) -> Skeleton:
    """Bones as long as those of the first dancer's nodes."""
    places = {node["name"]: node.get("translation", (0.0, 0.0, 0.0)) for node in book["nodes"]}
    offsets = torch.tensor([places[f"dancer 1 {joint}"] for joint in SMPL24.names])
    offsets[0] = SMPL24.offsets[0]  # the root's node stands where the dance begins
    own = Skeleton(SMPL24.names, SMPL24.parents, offsets.float())
    return SMPL24 if own.is_like(SMPL24) else own


def _values(book: dict, blob: bytes, number: int) -> np.ndarray:
    """The float array of an accessor; takes no more memory than the file has."""
    accessor = book["accessors"][number]
    view = book["bufferViews"][accessor["bufferView"]]
    width = {kind: c for c, kind in _KINDS.items()}[accessor["type"]]
    start, size = view.get("byteOffset", 0), 4 * width * accessor["count"]
    if accessor["componentType"] != FLOAT or start < 0 or size < 0 or start + size > len(blob):
        raise ValueError(f"accessor {number} does not lie in the file")
    flat = np.frombuffer(bytearray(blob[start : start + size]), dtype="<f4")
    if not np.isfinite(flat).all():
        raise ValueError(f"accessor {number} has numbers that are not finite")
    return flat.reshape(accessor["count"], width)


def _linear(color: str) -> list[float]:
    """A "#RRGGBB" colour in the linear units of glTF.

    >>> _linear("#FF0000")
    [1.0, 0.0, 0.0]
    """
    parts = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
