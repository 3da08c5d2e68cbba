r"""The skeletons that an animation in a glTF 2.0 file (.glb, .gltf) moves.

Read first: `dancediff.data.folder.tree`. The writer of dances is `dancediff.export.gltf`.

Joints are those of the skins, or, without skins, all nodes that the animation turns. The longest
animation is read from its first to its last key, at the rate of its key frames but at 30 a second
at least: a turn may have no more than two keys.

Symbols (axes: f frames · k key frames)
    key    times of a channel, seconds   (k,)
    value  what a node does then         (k, 3) or (k, 4): x, y, z, w of a unit quaternion
"""

import base64
import json
import struct
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import roma
import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.data.bvh import BVH
from dancediff.data.folder.tree import tree_from_world

OWN_FORMAT = "dancediff-gltf-1"  # of `dancediff.export.gltf`; its nodes stand as in frame 0
MOST_FRAMES = 200_000
MOST_RATE = 240.0
_WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_TYPES = {5126: "<f4", 5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2"}
_BROKEN = (
    ZeroDivisionError,
    LookupError,
    TypeError,
    AttributeError,
    RecursionError,
    OverflowError,
    RuntimeError,
    struct.error,
)


def read_gltf(path) -> list[BVH]:
    """Every skeleton that the file's longest animation moves, in metres.

    Raises: OSError for no such file; ValueError telling what is missing or damaged.
    """
    path = Path(path)
    content = path.read_bytes()
    try:
        book, blob = chunks(content) if content[:4] == b"glTF" else (json.loads(content), b"")
        return _Scene(book, blob, path.parent).recordings()
    except _BROKEN as err:
        raise ValueError(f"it is damaged ({type(err).__name__}: {err})") from err


def chunks(content: bytes) -> tuple[dict, bytes]:
    """The JSON and the binary part of a .glb.

    pygltflib, which writes our files, would build an object for every entry of a stranger's JSON:
    a hundred times slower.

    Raises: ValueError or struct.error when it is none.
    """
    magic, version, _ = struct.unpack_from("<4sII", content)
    length, kind = struct.unpack_from("<I4s", content, 12)
    if (magic, version, kind) != (b"glTF", 2, b"JSON"):
        raise ValueError("it does not begin as a glTF 2.0 file does")
    book = json.loads(content[20 : 20 + length])
    return book, content[28 + length :]  # behind the header of the second chunk


class _Scene:
    """Nodes of a file, and what an animation does to them."""

    def __init__(self, book: dict, blob: bytes, folder: Path):
        self.book, self.blob, self.folder = book, blob, folder
        self.nodes = book["nodes"]
        self.parents = [-1] * len(self.nodes)
        for p, node in enumerate(self.nodes):
            for c in node.get("children", []):
                self.parents[c] = p
        self.order = self._parents_first()

    def _parents_first(self) -> list[int]:
        order = [j for j, p in enumerate(self.parents) if p < 0]
        for j in order:
            order += self.nodes[j].get("children", [])
            if len(order) > len(self.nodes):
                break
        if sorted(order) != list(range(len(self.nodes))):
            raise ValueError("its nodes are no trees")
        return order

    def recordings(self) -> list[BVH]:
        """One for each skeleton that moves."""
        tracks = self._tracks()
        keys = [times for times, _, _ in tracks.values()]
        steps = np.concatenate([np.diff(times) for times in keys])
        if len(steps) == 0:
            raise ValueError("its animation has fewer than two key frames")
        first, last = min(times[0] for times in keys), max(times[-1] for times in keys)
        fps = min(MOST_RATE, max(FPS, 1 / float(np.median(steps))))
        f = int((last - first) * fps + 1e-3) + 1
        if f > MOST_FRAMES:
            raise ValueError(f"its animation lasts {last:.0f} s; at most {MOST_FRAMES} frames")
        world = self._world(tracks, first + np.arange(f) / fps)
        found = [self._tree(joints, world, fps) for joints in self._skeletons(tracks)]
        if not found:
            raise ValueError("its animation moves no skeleton")
        return found

    def _tracks(self) -> dict[tuple[int, str], tuple[np.ndarray, np.ndarray, str]]:
        """(node, path) -> key times, values, interpolation, of the animation that lasts longest."""
        best: dict = {}
        lasts = -1.0
        for animation in self.book.get("animations", []):
            tracks = {}
            for channel in animation["channels"]:
                target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
                if "node" not in target or target["path"] not in _SIZE:
                    continue  # morph targets
                how = sampler.get("interpolation", "LINEAR")
                key = self._values(sampler["input"])[:, 0].astype(np.float64)
                value = self._values(sampler["output"])
                rows = 3 if how == "CUBICSPLINE" else 1
                if len(value) != rows * len(key) or (np.diff(key) <= 0).any() or len(key) == 0:
                    raise ValueError(f"times of node {target['node']} do not fit its values")
                tracks[target["node"], target["path"]] = key, value.astype(np.float64), how
            length = max((key[-1] for key, _, _ in tracks.values()), default=-1.0)
            if length > lasts:
                best, lasts = tracks, length
        if not best:
            raise ValueError("it holds no animation of nodes")
        return best

    def _world(self, tracks: dict, times: np.ndarray) -> dict[int, Tensor]:
        """Node -> its matrix in the world in each frame, (f, 4, 4)."""
        world: dict[int, Tensor] = {}
        for j in self.order:
            local = self._local(j, tracks, times)
            p = self.parents[j]
            world[j] = local if p < 0 else world[p] @ local
        return world

    def _local(self, j: int, tracks: dict, times: np.ndarray) -> Tensor:
        node = self.nodes[j]
        if "matrix" in node:
            M = torch.tensor(node["matrix"], dtype=torch.float64).reshape(4, 4).T
            return M.expand(len(times), 4, 4)
        value: dict[str, np.ndarray] = {}
        for what, start in _SIZE.items():
            if (j, what) in tracks:
                value[what] = _between(tracks[j, what], times)
            else:
                fixed = np.array(node.get(what, start), dtype=np.float64)
                value[what] = np.broadcast_to(fixed, (len(times), len(start)))
        M = torch.eye(4, dtype=torch.float64).repeat(len(times), 1, 1)
        q = torch.nn.functional.normalize(torch.from_numpy(value["rotation"].copy()), dim=-1)
        scale = torch.from_numpy(value["scale"].copy())
        M[:, :3, :3] = roma.unitquat_to_rotmat(q) * scale[:, None]
        M[:, :3, 3] = torch.from_numpy(value["translation"].copy())
        return M

    def _skeletons(self, tracks: dict) -> list[list[int]]:
        """The joints of each skeleton that moves, parents first."""
        moved = {node for node, _ in tracks}
        skins = [set(skin["joints"]) for skin in self.book.get("skins", [])]
        joints = set().union(*skins) if any(skins) else {n for n, w in tracks if w == "rotation"}
        roots: dict[int, list[int]] = {}
        for j in self.order:
            if j in joints:
                top = j
                while (p := self._parent_in(top, joints)) >= 0:
                    top = p
                roots.setdefault(top, []).append(j)
        return [row for row in roots.values() if len(row) >= 12 and moved & set(row)]

    def _parent_in(self, j: int, joints: set[int]) -> int:
        j = self.parents[j]
        while j >= 0 and j not in joints:
            j = self.parents[j]
        return j

    def _tree(self, joints: list[int], world: dict, fps: float) -> BVH:
        names = [str(self.nodes[j].get("name", f"node {j}")) for j in joints]
        if len(set(names)) < len(names):
            names = [f"{name} {j}" for name, j in zip(names, joints, strict=True)]
        inside = set(joints)
        ups = [self._parent_in(j, inside) for j in joints]
        parents = tuple(-1 if p < 0 else joints.index(p) for p in ups)
        moving = _points_and_turns(world, joints)
        points, turned = _points_and_turns(self._rest(joints), joints)
        # a skin may have been bound at another size
        points = points * (_size(moving[0][:1], parents) / _size(points, parents))
        return tree_from_world(tuple(names), parents, moving, (points[0], turned[0]), fps)

    def _rest(self, joints: list[int]) -> dict[int, Tensor]:
        """The pose in which the skin was bound, else that of the nodes: matrices (1, 4, 4)."""
        for skin in self.book.get("skins", []):
            if set(joints) <= set(skin["joints"]) and "inverseBindMatrices" in skin:
                rows = torch.from_numpy(self._values(skin["inverseBindMatrices"]))
                bound = torch.linalg.inv(rows.reshape(-1, 1, 4, 4).mT)
                return dict(zip(skin["joints"], bound, strict=True))
        nodes = self.nodes
        if self.book["asset"].get("extras", {}).get("format") == OWN_FORMAT:
            self.nodes = [{**node, "rotation": _SIZE["rotation"]} for node in nodes]
        world = self._world({}, np.zeros(1))
        self.nodes = nodes
        return world

    def _values(self, number: int) -> np.ndarray:
        """The numbers of an accessor, (count, width); no more memory than the file has."""
        accessor = self.book["accessors"][number]
        if "sparse" in accessor or "bufferView" not in accessor:
            raise ValueError(f"accessor {number} is sparse or compressed; export it without")
        view = self.book["bufferViews"][accessor["bufferView"]]
        if "extensions" in view:
            raise ValueError(f"accessor {number} is compressed; export the file without it")
        kind = np.dtype(_TYPES[accessor["componentType"]])
        width, count = _WIDTH[accessor["type"]], accessor["count"]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        size, blob = kind.itemsize * width * count, self._buffer(view["buffer"])
        if start < 0 or size <= 0 or start + size > len(blob):
            raise ValueError(f"accessor {number} does not lie in the file")
        flat = np.frombuffer(blob[start : start + size], dtype=kind).astype(np.float64)
        if kind.kind != "f":  # normalised whole numbers
            flat = np.maximum(flat / np.iinfo(kind).max, -1.0)
        if not np.isfinite(flat).all():
            raise ValueError(f"accessor {number} has numbers that are not finite")
        return flat.reshape(count, width)

    def _buffer(self, number: int) -> bytes:
        uri = self.book["buffers"][number].get("uri")
        if uri is None:
            return self.blob
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        name = unquote(uri)
        if Path(name).name != name:
            raise ValueError(f"its buffer {name!r} lies in another folder; put it beside the file")
        return (self.folder / name).read_bytes()


_SIZE = {
    "translation": (0.0, 0.0, 0.0),
    "rotation": (0.0, 0.0, 0.0, 1.0),
    "scale": (1.0, 1.0, 1.0),
}


def _size(points: Tensor, parents: tuple[int, ...]) -> float:
    """Length of all bones, metres."""
    pairs = [(j, p) for j, p in enumerate(parents) if p >= 0]
    return sum((points[0, j] - points[0, p]).norm().item() for j, p in pairs)


def _points_and_turns(world: dict[int, Tensor], joints: list[int]) -> tuple[Tensor, Tensor]:
    """Positions (f, j, 3) and rotations (f, j, 3, 3) of joints; scales are left out.

    Raises: ValueError when a joint is mirrored or shrunk to nothing.
    """
    M = torch.stack([world[j] for j in joints], dim=1)
    if not (torch.linalg.det(M[..., :3, :3]) > 1e-12).all():
        raise ValueError("a joint is mirrored or has no size; apply scales before the export")
    return M[..., :3, 3], roma.special_gramschmidt(M[..., :3, :3])


def _between(track: tuple[np.ndarray, np.ndarray, str], times: np.ndarray) -> np.ndarray:
    """What a channel says at these times, (f, width)."""
    key, value, how = track
    times = times + 1e-5  # key times are written in single precision
    after = np.clip(np.searchsorted(key, times, side="right"), 1, max(len(key) - 1, 1))
    before, after = after - 1, np.minimum(after, len(key) - 1)
    step = key[after] - key[before]
    w = np.clip((times - key[before]) / np.where(step > 0, step, 1), 0, 1)[:, None]
    if how == "CUBICSPLINE":  # in-tangent, value, out-tangent
        coming, at, going = value.reshape(len(key), 3, -1).transpose(1, 0, 2)
        h, t = step[:, None], w
        return (
            (2 * t**3 - 3 * t**2 + 1) * at[before]
            + h * (t**3 - 2 * t**2 + t) * going[before]
            + (3 * t**2 - 2 * t**3) * at[after]
            + h * (t**3 - t**2) * coming[after]
        )
    if how == "STEP":
        w = (w >= 1).astype(np.float64)
    x, y = value[before], value[after]
    if value.shape[1] != 4:
        return x + w * (y - x)
    q0, q1 = (torch.nn.functional.normalize(torch.from_numpy(q), dim=-1) for q in (x, y))
    q1 = torch.where((q0 * q1).sum(-1, keepdim=True) < 0, -q1, q1)
    angle = (q0 * q1).sum(-1, keepdim=True).clamp(-1, 1).acos()
    part = torch.from_numpy(w)
    sine = angle.sin().clamp_min(1e-9)
    arc = ((1 - part) * angle).sin() / sine * q0 + (part * angle).sin() / sine * q1
    return torch.where(angle < 1e-4, torch.lerp(q0, q1, part), arc).numpy()
