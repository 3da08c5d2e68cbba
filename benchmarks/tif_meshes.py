r"""How often capsules and a skinned mesh agree on whether two dancers touch.

    python benchmarks/tif_meshes.py --data path/to/data

Reads ``cmu/`` and ``mesh/makehuman_cmu_mb.glb`` of that folder and prints the table of
docs/metrics_collision.md. The mesh is a binary glTF (.glb) with one skinned body whose bones carry
the names of the CMU rig, such as the CC0 MakeHuman body.

Symbols (axes: f frames · v vertices · j joints)
    rest      where the 24 joints lie in the mesh as it was modelled       (j, 3)
    joints    where they are in the dance, metres                          (..., j, 3)
    vertices  the surface, metres                                          (..., v, 3)
    faces     triangles, counter-clockwise seen from outside               (k, 3)
"""

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro
from torch import Tensor

from dancediff.data.cmu import cmu_jobs
from dancediff.metrics.collision import touches
from dancediff.motion.skeleton import SMPL24

# SMPL-24 joint <- bone of the CMU rig that begins there; # is Left or Right
_MIDDLE = {"root": "Hips", "belly": "LowerBack", "spine": "Spine", "chest": "Spine1"}
_MIDDLE |= {"neck": "Neck", "head": "Head"}
_SIDE = {"hip": "#UpLeg", "knee": "#Leg", "ankle": "#Foot", "toe": "#ToeBase"}
_SIDE |= {"collar": "#Shoulder", "shoulder": "#Arm", "elbow": "#ForeArm", "wrist": "#Hand"}
_SIDE |= {"hand": "#HandFinger1"}
_SAME = {"LHipJoint": "root", "RHipJoint": "root", "Neck1": "neck"}  # bones without a joint of ours
_SAME |= {"LThumb": "lwrist", "LeftFingerBase": "lwrist"}
_SAME |= {"RThumb": "rwrist", "RightFingerBase": "rwrist"}
_DTYPES = {5123: np.dtype("<u2"), 5125: np.dtype("<u4"), 5126: np.dtype("<f4")}
_WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
TRUNK = (0, 3, 6, 9, 13, 14)  # pelvis, spine, collars
_BROKEN = (OSError, ValueError, LookupError, TypeError, AttributeError, StopIteration)
_TESTED = 64  # vertices, deepest first, whose winding number is taken before a pair counts as apart


def bone_names() -> dict[str, str]:
    """Which of our joints each bone of the rig follows.

    >>> bone_names()["LeftForeArm"], bone_names()["RThumb"]
    ('lelbow', 'rwrist')
    """
    names = {bone: joint for joint, bone in _MIDDLE.items()}
    for letter, word in (("l", "Left"), ("r", "Right")):
        names |= {bone.replace("#", word): letter + joint for joint, bone in _SIDE.items()}
    return names | _SAME


@dataclass(frozen=True, eq=False)
class BodyMesh:
    """A closed surface that follows 24 joints; see `load` and `follow`."""

    rest: np.ndarray  # (j, 3)
    vertices: np.ndarray  # (v, 3)
    faces: np.ndarray  # (k, 3)
    weights: np.ndarray  # (v, j), rows sum to 1
    tall: float  # SMPL-24's trunk in lengths of the mesh's

    @classmethod
    def load(cls, path) -> "BodyMesh":
        """Read a .glb.

        Raises: ValueError naming the file when it is no such body.
        """
        try:
            return _fit_trunk(*_read_glb(Path(path)))
        except (*_BROKEN, struct.error) as err:
            raise ValueError(
                f"mesh={str(path)!r} is no .glb of a body skinned to the CMU rig: {err!r}"
            ) from err

    def follow(self, joints: np.ndarray) -> np.ndarray:
        r"""The surface in the pose of these joints, by linear blend skinning.

        $$x' = \sum_j w_j\,\big(p_j + Q_j\,S_j\,(x - m_j)\big)$$

        with $m_j$ the joint at rest, $p_j$ in the dance, and $Q_j$, $S_j$ of `bone_turns`.

        Shapes: joints (..., j, 3) metres -> (..., v, 3) metres.
        """
        joints, Q, S = bone_turns(self.rest, self.tall, joints)
        A = Q @ S
        shift = joints - np.einsum("...jab,jb->...ja", A, self.rest)
        both = np.concatenate([A, shift[..., None]], -1).reshape(*joints.shape[:-2], -1, 12)
        blend = (self.weights @ both).reshape(*joints.shape[:-2], -1, 3, 4)
        return np.einsum("...vab,vb->...va", blend[..., :3], self.vertices) + blend[..., 3]


def bone_turns(rest: np.ndarray, tall: float, joints: np.ndarray):
    r"""Where each bone begins, how it turns from rest to the dance, and how it stretches.

    A joint with several children (pelvis, chest) takes the rotation that fits all of them best
    (Kabsch); one with a single child takes its parent's turn and the smallest turn that then
    brings the bone into its direction; a joint without a child turns with its parent. The trunk
    stands at rest as SMPL-24's does and stretches upwards only; limbs and neck begin at the mesh's
    own angles and stretch along themselves to the dancer's length. Thighs begin at the mesh's hips,
    which lie further apart than SMPL-24's.

    Joints alone do not say how a limb is turned about its own axis, which round limbs hardly show.

    Shapes: rest (j, 3), joints (..., j, 3) metres -> joints (..., j, 3), turns and stretches
    (..., j, 3, 3).
    """
    parents, joints = SMPL24.parents, joints.copy()
    Q = np.empty((*joints.shape[:-2], len(parents), 3, 3))
    S = np.broadcast_to(np.eye(3), Q.shape).copy()
    for j, p in enumerate(parents):
        children = [c for c, parent in enumerate(parents) if parent == j]
        old = SMPL24.offsets.numpy()[children] if j in TRUNK else rest[children] - rest[j]
        new = joints[..., children, :] - joints[..., j, None, :]
        Q[..., j, :, :] = _kabsch(old, new) if len(children) > 1 else Q[..., p, :, :]
        if len(children) == 1:
            old, new = old[0], new[..., 0, :]
            before = Q[..., j, :, :] @ (old / np.linalg.norm(old))
            Q[..., j, :, :] = _swing(before, new) @ Q[..., j, :, :]
        if j in TRUNK:
            S[..., j, 1, 1] = tall
        elif children:
            longer = np.linalg.norm(new, axis=-1) / np.linalg.norm(old) - 1
            S[..., j, :, :] += longer[..., None, None] * np.outer(old, old) / (old @ old)
        if j == 0:
            hips = (rest[1:3] - rest[0]) * (1, tall, 1)
            joints[..., 1:3, :] = joints[..., :1, :] + hips @ np.swapaxes(Q[..., 0, :, :], -1, -2)
    return joints, Q, S


def surfaces_meet(a: np.ndarray, b: np.ndarray, faces: np.ndarray, inner=None) -> bool:
    r"""Whether a vertex of one surface, or a point ``inner`` to it, lies inside the other.

    Inside means a winding number above one half, $\frac1{4\pi}\sum_k \Omega_k(x) > \frac12$, with
    $\Omega_k$ the solid angle of triangle k seen from x. Vertices are tried only where they lie
    behind the other surface's nearest vertex, the deepest 64 of them. Edges that cut a face while
    all vertices stay outside are missed: at some 1 cm between vertices that is a graze.

    Shapes: a, b (v, 3) metres; faces (k, 3); inner: a pair of (i, 3), points inside a and b.
    """
    from scipy.spatial import cKDTree

    low, high = np.maximum(a.min(0), b.min(0)), np.minimum(a.max(0), b.max(0))
    if (low > high).any():
        return False
    for k, (x, other) in enumerate(((a, b), (b, a))):
        near = x[((x >= low) & (x <= high)).all(-1)]
        points = np.zeros((0, 3)) if inner is None else inner[k]
        if len(near):
            nearest = cKDTree(other).query(near)[1]
            behind = ((near - other[nearest]) * _normals(other, faces)[nearest]).sum(-1)
            deepest = np.argsort(behind)[:_TESTED]
            points = np.concatenate([points, near[deepest[behind[deepest] < 0]]])
        if len(points) and (winding_number(points, other[faces]) > 0.5).any():
            return True
    return False


def winding_number(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    r"""How often a closed surface surrounds each point: 1 inside, 0 outside.

    $$\tan\frac{\Omega}{2} = \frac{\det[a\,b\,c]}
        {|a||b||c| + (a\cdot b)|c| + (b\cdot c)|a| + (c\cdot a)|b|}$$

    for a triangle with corners a, b, c seen from the point.

    Source: Van Oosterom and Strackee 1983.

    Shapes: points (i, 3), triangles (k, 3, 3) metres -> (i,).
    """
    found = []
    for x in points:
        a, b, c = np.moveaxis(triangles - x, 1, 0)
        la, lb, lc = (np.sqrt(np.einsum("kx,kx->k", v, v)) for v in (a, b, c))
        ab, bc, ca = (np.einsum("kx,kx->k", u, v) for u, v in ((a, b), (b, c), (c, a)))
        det = np.einsum("kx,kx->k", a, np.cross(b, c))
        solid = 2 * np.arctan2(det, la * lb * lc + ab * lc + bc * la + ca * lb)
        found.append(solid.sum() / (4 * np.pi))
    return np.array(found)


def _normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Sum of the normals of the triangles around each vertex, (v, 3); only the side matters."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    flat = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    at = faces.ravel()
    return np.stack([np.bincount(at, flat[:, i], len(vertices)) for i in range(3)], -1)


def _kabsch(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """The rotation that carries old (c, 3) closest to new (..., c, 3), after scaling each bone."""
    old = old / np.linalg.norm(old, axis=-1, keepdims=True)
    new = new / np.maximum(np.linalg.norm(new, axis=-1, keepdims=True), 1e-9)
    U, _, Vt = np.linalg.svd(np.einsum("ci,...cj->...ji", old, new))
    U[..., :, 2] *= np.linalg.det(U @ Vt)[..., None]
    return U @ Vt


def _swing(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    r"""The smallest rotation from unit u to v's direction: $I + K + K^2 / (1 + u \cdot v)$."""
    v = v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9)
    w = np.cross(u, v)
    zero = np.zeros(w.shape[:-1])
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    K = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*w.shape[:-1], 3, 3)
    cos = np.maximum((u * v).sum(-1), -1 + 1e-6)[..., None, None]
    return np.eye(3) + K + K @ K / (1 + cos)


def _fit_trunk(rest, vertices, faces, weights) -> BodyMesh:
    """Put SMPL-24's pelvis, spine and collars into the mesh, hips on hips, shoulders as high."""
    T = np.zeros_like(rest)
    for j, p in enumerate(SMPL24.parents[1:], start=1):
        T[j] = T[p] + SMPL24.offsets[j].numpy()
    (hips, shoulders), (our_hips, our_shoulders) = (
        (x[1:3].mean(0), x[16:18].mean(0)) for x in (rest, T)
    )
    tall = (our_shoulders - our_hips)[1] / (shoulders - hips)[1]
    rest = rest.copy()
    rest[list(TRUNK)] = hips + (T[list(TRUNK)] - our_hips) / (1, tall, 1)
    return BodyMesh(rest, vertices, faces, weights, float(tall))


def _read_glb(path: Path) -> tuple:
    data = path.read_bytes()
    magic, _, _, length, kind = struct.unpack_from("<4sII I4s", data)
    if magic != b"glTF" or kind != b"JSON":
        raise ValueError("it does not begin as a binary glTF")
    gltf = json.loads(data[20 : 20 + length])
    buffer = data[28 + length :]
    node = next(node for node in gltf["nodes"] if "skin" in node and "mesh" in node)
    part = gltf["meshes"][node["mesh"]]["primitives"][0]
    vertices, bone, weight = (
        _accessor(gltf, buffer, part["attributes"][key])
        for key in ("POSITION", "JOINTS_0", "WEIGHTS_0")
    )
    faces = _accessor(gltf, buffer, part["indices"]).reshape(-1, 3).astype(int)
    heads, names = _bone_heads(gltf), bone_names()
    order = [gltf["nodes"][k]["name"] for k in gltf["skins"][node["skin"]]["joints"]]
    ours = np.array([SMPL24.index(names[name]) for name in order])
    starts = {joint: bone for bone, joint in names.items() if bone not in _SAME}
    rest = np.array([heads[starts[joint]] for joint in SMPL24.names])
    weights = np.zeros((len(vertices), len(rest)))
    rows = np.arange(len(vertices))[:, None]
    np.add.at(weights, (rows, ours[bone.astype(int)]), weight)
    weights /= weights.sum(1, keepdims=True)
    if faces.max() >= len(vertices) or not all(np.isfinite(x).all() for x in (weights, vertices)):
        raise ValueError("its faces point to nothing, or a number is not finite")
    return rest, vertices.astype(np.float64), faces, weights


def _accessor(gltf: dict, buffer: bytes, k: int) -> np.ndarray:
    entry = gltf["accessors"][k]
    view = gltf["bufferViews"][entry["bufferView"]]
    if "byteStride" in view or "sparse" in entry:
        raise ValueError("its arrays are interleaved or sparse; export it plain")
    dtype, width = _DTYPES[entry["componentType"]], _WIDTH[entry["type"]]
    start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
    flat = np.frombuffer(buffer, dtype, entry["count"] * width, start)
    return flat.reshape(-1, width)


def _bone_heads(gltf: dict) -> dict[str, np.ndarray]:
    """Where each bone begins; the rig's bones are not turned at rest."""
    nodes, heads = gltf["nodes"], {}
    parent = {c: k for k, node in enumerate(nodes) for c in node.get("children", [])}
    for k, node in enumerate(nodes):
        at, up = np.zeros(3), k
        for _ in nodes:  # no chain is longer, unless it is a ring
            if up is None:
                break
            if "rotation" in nodes[up] or "matrix" in nodes[up]:
                raise ValueError(f"bone {node.get('name')!r} is turned at rest; export it unturned")
            at, up = at + np.array(nodes[up].get("translation", (0, 0, 0))), parent.get(up)
        heads[node.get("name")] = at
    return heads


def meshes_touch(joints: Tensor, body: BodyMesh) -> Tensor:
    """As `dancediff.metrics.collision.touches`, for the surfaces; 0.1 s a frame of two dancers.

    Shapes: joints (n, f, 24, 3) metres -> bool (p, f).
    """
    pairs = torch.combinations(torch.arange(len(joints))).tolist()
    points = joints.double().numpy()
    touching = torch.zeros(len(pairs), joints.shape[1], dtype=torch.bool)
    for frame in range(joints.shape[1]):
        surface = body.follow(points[:, frame])
        for k, (i, j) in enumerate(pairs):
            inner = points[i, frame], points[j, frame]
            touching[k, frame] = surfaces_meet(surface[i], surface[j], body.faces, inner)
    return touching


def main(data: Path) -> None:
    """Every 25th frame of the salsa duets, counted: capsules (rows), mesh (columns)."""
    body, table = BodyMesh.load(data / "mesh" / "makehuman_cmu_mb.glb"), torch.zeros(2, 2)
    for job in cmu_jobs(data / "cmu"):
        if job.name.startswith("salsa"):
            joints = job.make().motion.joints()[:, 12::25]
            at = touches(joints)[0].long(), meshes_touch(joints, body)[0].long()
            table.index_put_(at, torch.tensor(1.0), accumulate=True)
    print(table)


if __name__ == "__main__":
    tyro.cli(main)
