"""The body with a skin that benchmarks/tif_meshes.py compares capsules with."""

import importlib.util
import json
import struct
import sys

import numpy as np
import pytest
import torch

from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import SMPL24, forward_kinematics
from places import BENCHMARKS

PATH = BENCHMARKS / "tif_meshes.py"
SPEC = importlib.util.spec_from_file_location("tif_meshes", PATH)
MESHES = importlib.util.module_from_spec(SPEC)
sys.modules[SPEC.name] = MESHES  # dataclasses look their module up
SPEC.loader.exec_module(MESHES)
BodyMesh, surfaces_meet = MESHES.BodyMesh, MESHES.surfaces_meet
bone_names, winding_number = MESHES.bone_names, MESHES.winding_number

# fmt: off
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
CUBE = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
])  # counter-clockwise from outside
# fmt: on


def rest_joints(pose=None, root=(0.0, 0.95, 0.0)):
    pose = torch.eye(3).expand(24, 3, 3) if pose is None else pose
    return forward_kinematics(pose, torch.tensor(root)).double().numpy()


def write_glb(path, *, bones, points, faces, bone_of, **more):
    """A body in which every vertex follows one bone."""
    joints = np.zeros((len(points), 4), "<u2")
    joints[:, 0] = bone_of
    weights = np.zeros((len(points), 4), "<f4")
    weights[:, 0] = 1
    parts = [points.astype("<f4"), joints, weights, faces.astype("<u2").reshape(-1, 1)]
    kinds = [("VEC3", 5126), ("VEC4", 5123), ("VEC4", 5126), ("SCALAR", 5123)]
    views, entries, data = [], [], b""
    for k, (part, (shape, kind)) in enumerate(zip(parts, kinds, strict=True)):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": part.nbytes})
        entries.append({"bufferView": k, "componentType": kind, "type": shape, "count": len(part)})
        data += part.tobytes()
    nodes = [{"name": "Body", "mesh": 0, "skin": 0}]
    nodes += [{"name": name, "translation": list(map(float, at))} for name, at in bones.items()]
    primitive = {"attributes": {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2}, "indices": 3}
    gltf = {
        "nodes": nodes,
        "meshes": [{"primitives": [primitive]}],
        "skins": [{"joints": list(range(1, len(nodes)))}],
        "accessors": entries,
        "bufferViews": views,
        **more,
    }
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 28 + len(text) + len(data), len(text), b"JSON")
    path.write_bytes(head + text + struct.pack("<I4s", len(data), b"BIN\0") + data)
    return path


@pytest.fixture
def body(tmp_path):
    """Cubes of 6 cm on the head and on each forearm, on a rig shaped like SMPL-24."""
    names = {bone: joint for bone, joint in bone_names().items()}
    at = dict(zip(SMPL24.names, rest_joints(), strict=True))
    bones = {bone: at[joint] for bone, joint in names.items()}
    order = list(bones)
    carriers = ["Head", "LeftForeArm", "RightForeArm"]
    points = np.concatenate([0.06 * (CORNERS - 0.5) + bones[name] for name in carriers])
    faces = np.concatenate([CUBE + 8 * k for k in range(3)])
    bone_of = np.repeat([order.index(name) for name in carriers], 8)
    return write_glb(tmp_path / "a.glb", bones=bones, points=points, faces=faces, bone_of=bone_of)


def test_winding_number_of_a_cube():
    points = np.array([[0.5, 0.5, 0.5], [0.01, 0.99, 0.5], [1.01, 0.5, 0.5], [5, 5, 5]])
    assert np.allclose(winding_number(points, CORNERS[CUBE]), [1, 1, 0, 0], atol=1e-12)


def test_cubes_meet_where_they_overlap():
    assert surfaces_meet(CORNERS, CORNERS + np.array([0.9, 0.05, 0.05]), CUBE)
    assert not surfaces_meet(CORNERS, CORNERS + np.array([1.01, 0, 0]), CUBE)
    assert not surfaces_meet(CORNERS, CORNERS + 3, CUBE)
    small = 0.2 * CORNERS + 0.4  # one within the other
    assert surfaces_meet(CORNERS, small, CUBE) and surfaces_meet(small, CORNERS, CUBE)
    middle = np.array([[0.5, 0.5, 0.5]])  # in one place no vertex is inside, but a point within is
    assert surfaces_meet(CORNERS, CORNERS.copy(), CUBE, (middle, middle))


def test_the_surface_stays_at_rest_and_follows_the_root(body):
    mesh = BodyMesh.load(body)
    assert np.allclose(mesh.follow(rest_joints()), mesh.vertices, atol=1e-6)
    moved = rest_joints(root=(2.0, 0.5, -1.0))
    assert np.allclose(mesh.follow(moved), mesh.vertices + moved[0] - rest_joints()[0], atol=1e-6)


def test_the_surface_turns_with_the_body_and_the_elbow(body):
    mesh, pose = BodyMesh.load(body), torch.eye(3).repeat(24, 1, 1)
    pose[0] = axis_angle_to_matrix(torch.tensor([0.2, 1.0, -0.3]))
    R, root = pose[0].double().numpy(), np.array([0, 0.95, 0])
    turned = (mesh.vertices - root) @ R.T + root
    assert np.allclose(mesh.follow(rest_joints(pose)), turned, atol=1e-5)
    pose = torch.eye(3).repeat(24, 1, 1)
    pose[18] = axis_angle_to_matrix(torch.tensor([0.0, 0.0, 1.2]))  # square to the forearm
    elbow, E = rest_joints()[18], pose[18].double().numpy()
    forearm = slice(8, 16)
    assert np.allclose(
        mesh.follow(rest_joints(pose))[forearm],
        (mesh.vertices[forearm] - elbow) @ E.T + elbow,
        atol=2e-3,  # the bone is not exactly square to the hinge, so the smallest turn differs
    )


def test_many_frames_at_once_equal_one_by_one(body):
    mesh = BodyMesh.load(body)
    g = torch.Generator().manual_seed(0)
    poses = axis_angle_to_matrix(torch.randn(5, 24, 3, generator=g))
    joints = forward_kinematics(poses, torch.zeros(5, 3)).double().numpy()
    each = np.stack([mesh.follow(x) for x in joints])
    assert np.allclose(mesh.follow(joints), each, atol=1e-9)
    assert np.isfinite(each).all()


def test_other_files_are_refused(tmp_path, body):
    data = body.read_bytes()
    for content in (
        b"",
        b"glTF",
        b"PK" + data[2:],
        data[:-600],
        data.replace(b"LeftArm", b"LeftAxx"),
    ):
        path = tmp_path / "b.glb"
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"mesh='.*b\.glb'"):
            BodyMesh.load(path)
    with pytest.raises(ValueError, match=r"none\.glb"):
        BodyMesh.load(tmp_path / "none.glb")


def test_no_damaged_file_escapes_as_another_error(tmp_path, body):
    data, rng = bytearray(body.read_bytes()), np.random.default_rng(0)
    text = int.from_bytes(data[12:16], "little")
    refused = 0
    for _ in range(200):
        bad = bytearray(data)
        for at in rng.integers(0, 20 + text, 3):
            bad[at] = rng.choice(list(b'0123456789-"[]{},:x'))
        path = tmp_path / "c.glb"
        path.write_bytes(bad)
        with np.errstate(all="ignore"):
            try:
                BodyMesh.load(path)
            except ValueError as err:
                refused += "c.glb" in str(err)
    assert refused > 50


def test_a_ring_of_bones_ends(tmp_path, body):
    data = body.read_bytes()
    path = tmp_path / "d.glb"
    path.write_bytes(data.replace(b'"name": "Hips"', b'"children":[1]'))
    with pytest.raises(ValueError, match=r"d\.glb"):
        BodyMesh.load(path)


def test_the_cc0_body_keeps_its_shape(real_data):
    path = real_data / "mesh" / "makehuman_cmu_mb.glb"
    if not path.is_file():
        pytest.skip(f"no {path.name} in {real_data}")
    mesh = BodyMesh.load(path)
    surface = mesh.follow(rest_joints())
    width, height, depth = surface.max(0) - surface.min(0)
    assert 1.6 < width < 1.85  # arms out
    assert 1.6 < height < 1.8
    assert 0.2 < depth < 0.45
    a, b, c = surface[mesh.faces].transpose(1, 0, 2)
    litres = (a * np.cross(b, c)).sum() / 6 * 1000
    assert 45 < litres < 80
    inside = winding_number(rest_joints()[[0, 6, 12, 15, 4, 18]], surface[mesh.faces])
    assert np.allclose(inside, 1, atol=1e-6)


def test_dancers_in_one_place_touch_and_far_ones_do_not(body):
    mesh = BodyMesh.load(body)
    pair = torch.from_numpy(np.stack([rest_joints(), rest_joints()]))[:, None]
    assert MESHES.meshes_touch(pair, mesh).tolist() == [[True]]
    pair[1, ..., 0] += 3
    assert MESHES.meshes_touch(pair, mesh).tolist() == [[False]]
