"""A .glb is valid, shows what the motion does, and comes back within a millimetre."""

import json
import os
import shutil
import subprocess

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.export.gltf import load_glb, save_glb
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import world_rotations
from dancediff.viz.palette import dancer_color
from dancediff.viz.skin import body_skin, rest_joints
from dancediff.viz.solids import body_solids
from places import ROOT

pygltflib = pytest.importorskip("pygltflib")
TOOLS = ROOT / "tests" / "js"
VALIDATOR = TOOLS / "node_modules" / "gltf-validator"
REQUIRED = "node" in os.environ.get("DANCEDIFF_REQUIRE", "")


def skinned_points(motion: Motion) -> np.ndarray:
    """Linear blend skinning in numpy: what the graphics card does; (n, f, v, 3) metres."""
    skin, Q, p = body_skin(), world_rotations(motion.pose).numpy(), motion.joints().numpy()
    moved = np.zeros((*p.shape[:2], *skin.points.shape), dtype=np.float32)
    for j, rest in enumerate(rest_joints()):
        weight = np.where(skin.joints == j, skin.weights, 0).sum(1)
        who = weight > 0
        at = np.einsum("nfab,vb->nfva", Q[:, :, j], skin.points[who] - rest) + p[:, :, j, None]
        moved[:, :, who] += weight[who, None] * at
    return moved


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.2, 6, 0.5), dancers=3, seed=1)[0]


@pytest.fixture(scope="module")
def path(dance, tmp_path_factory):
    return save_glb(dance, tmp_path_factory.mktemp("glb") / "dance.glb")


@pytest.fixture(scope="module")
def dressed(dance, tmp_path_factory):
    return dance.save(tmp_path_factory.mktemp("mesh") / "dance.glb", body="mesh")


@pytest.mark.parametrize("which", ["path", "dressed"])
def test_comes_back_within_a_millimetre(dance, which, request):
    again = Motion.load(request.getfixturevalue(which))
    assert (again.num_dancers, again.num_frames, again.fps) == (3, dance.num_frames, 30.0)
    assert (again.joints() - dance.joints()).norm(dim=-1).max() < 1e-3


def quaternion_matrix(q):
    x, y, z, w = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def test_nodes_stand_where_joints_are_in_the_first_frame(dance, path):
    book = pygltflib.GLTF2.load(str(path))
    joints = dance.joints()[:, 0].numpy()
    found = {}

    def walk(number, origin, turn):
        node = book.nodes[number]
        here = origin + turn @ np.array(node.translation)
        found[node.name] = here
        for child in node.children or []:
            walk(child, here, turn @ quaternion_matrix(node.rotation))

    for root in book.scenes[book.scene].nodes:
        walk(root, np.zeros(3), np.eye(3))
    assert len(found) == 72
    for k in range(3):
        for j, name in enumerate(dance.skeleton.names):
            np.testing.assert_allclose(found[f"dancer {k + 1} {name}"], joints[k, j], atol=1e-4)


def test_one_animation_in_seconds_moves_every_joint(dance, path):
    book = pygltflib.GLTF2.load(str(path))
    (animation,) = book.animations
    assert len(animation.channels) == 3 * 25
    clock = book.accessors[animation.samplers[0].input]
    assert clock.min == [0.0] and clock.max[0] == pytest.approx((dance.num_frames - 1) / 30)


def test_every_dancer_has_her_colour_and_shares_the_shape(dance, path):
    book = pygltflib.GLTF2.load(str(path))
    skins = [m for m in book.materials if not m.name.endswith("face")]
    seen = []
    for k, skin in enumerate(skins):
        linear = np.array(skin.pbrMetallicRoughness.baseColorFactor[:3])
        srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        seen.append("#" + "".join(f"{round(255 * c):02X}" for c in srgb))
        assert seen[-1] == dancer_color(k)
    knees = [m for m in book.meshes if m.name.endswith("lknee")]
    assert len({m.primitives[0].attributes.POSITION for m in knees}) == 1


def accessor(book, number, kind, shape):
    view = book.bufferViews[book.accessors[number].bufferView]
    count = book.accessors[number].count * int(np.prod(shape))
    return np.frombuffer(book.binary_blob(), kind, count, view.byteOffset).reshape(-1, *shape)


def test_the_skin_is_where_skinning_by_hand_puts_it(dance, dressed):
    book = pygltflib.GLTF2.load(str(dressed))
    assert [book.nodes[n].name for n in book.scenes[0].nodes[3:]] == [
        f"dancer {k} body" for k in (1, 2, 3)
    ]
    skin = book.skins[1]
    unbind = accessor(book, skin.inverseBindMatrices, "<f4", (4, 4)).transpose(0, 2, 1)
    world = {}

    def walk(number, parent):
        node, here = book.nodes[number], np.eye(4)
        here[:3, :3], here[:3, 3] = quaternion_matrix(node.rotation), node.translation
        world[number] = parent @ here
        for child in node.children or []:
            walk(child, world[number])

    walk(skin.skeleton, np.eye(4))  # nodes stand as in the first frame
    attributes = book.meshes[book.nodes[book.scenes[0].nodes[4]].mesh].primitives[0].attributes
    points = accessor(book, attributes.POSITION, "<f4", (3,))
    follows = accessor(book, attributes.JOINTS_0, "<u2", (4,))
    weights = accessor(book, attributes.WEIGHTS_0, "<f4", (4,))
    turn = np.stack([world[j] for j in skin.joints]) @ unbind
    blend = (turn[follows] * weights[..., None, None]).sum(1)
    there = np.einsum("vab,vb->va", blend, np.c_[points, np.ones(len(points))])[:, :3]
    np.testing.assert_allclose(there, skinned_points(dance.frames(0, 1))[1, 0], atol=1e-4)


def test_the_skin_is_a_light_human_body_around_our_joints(dance):
    skin = body_skin()
    low, high = skin.points.min(0), skin.points.max(0)
    assert len(skin.triangles) <= 8000
    np.testing.assert_allclose(np.linalg.norm(skin.normals, axis=1), 1, atol=1e-5)
    assert 1.6 < high[1] - low[1] < 1.9 and 1.6 < high[0] - low[0] < 2.0
    a, b, c = (skin.points[skin.triangles[:, i]] for i in range(3))
    volume = (a * np.cross(b, c)).sum() / 6
    assert 0.045 < volume < 0.09  # cubic metres; a person of 70 kg has 0.07
    points, joints = skinned_points(dance), dance.joints().numpy()
    near = np.linalg.norm(points[:, ::30, :, None] - joints[:, ::30, None], axis=-1).min(2)
    assert near.max() < 0.13  # every joint is under the skin
    standing = points[..., 1].min(-1)
    assert abs(np.median(standing)) < 0.02  # soles are on the floor


def test_an_unknown_body_is_refused(dance, tmp_path):
    with pytest.raises(ValueError, match="body='ghost' is unknown"):
        dance.save(tmp_path / "dance.glb", body="ghost")
    with pytest.raises(ValueError, match=r"body='mesh' goes with \.glb only"):
        dance.save(tmp_path / "dance.bvh", body="mesh")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("joint", ["root", "lknee", "head", "face"])
def test_solids_are_closed_to_the_outside(joint):
    points, normals, triangles = body_solids()[joint]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1, atol=1e-5)
    assert triangles.max() < len(points)
    a, b, c = (points[triangles[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    assert (np.linalg.norm(face, axis=-1) > 0).all()
    outward = (face * normals[triangles].mean(1)).sum(-1)
    assert (outward > 0).mean() > 0.999  # seen from outside, corners run anticlockwise


@pytest.mark.skipif(
    not REQUIRED and not (VALIDATOR.is_dir() and shutil.which("node")),
    reason="needs node: npm install --no-package-lock --prefix tests/js",
)
@pytest.mark.parametrize("which", ["path", "dressed"])
def test_khronos_validator_has_nothing_to_say(which, request):
    path = request.getfixturevalue(which)
    command = ["node", str(TOOLS / "validate_gltf.js"), str(path)]
    out = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout
    issues = json.loads(out)["issues"]
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]
    assert {m["code"] for m in issues["messages"]} <= {"NODE_EMPTY"}  # hands have no solid


@pytest.mark.parametrize("keep", [0.99, 0.5, 0.0])
def test_a_damaged_file_is_refused(path, tmp_path, keep):
    content = path.read_bytes()
    bad = tmp_path / "bad.glb"
    bad.write_bytes(content[: int(keep * len(content))])
    with pytest.raises(ValueError, match=r"bad\.glb"):
        load_glb(bad)


def test_a_file_that_promises_too_much_is_refused(path, tmp_path):
    book = pygltflib.GLTF2.load(str(path))
    output = book.animations[0].samplers[3].output
    book.accessors[output].count = 10**12
    book.save_binary(str(tmp_path / "huge.glb"))
    with pytest.raises(ValueError, match="does not lie in the file"):
        load_glb(tmp_path / "huge.glb")


def test_another_program_s_file_is_refused(tmp_path):
    pygltflib.GLTF2().save_binary(str(tmp_path / "other.glb"))
    with pytest.raises(ValueError, match="dancediff-gltf-1"):
        load_glb(tmp_path / "other.glb")
    with pytest.raises(FileNotFoundError):
        load_glb(tmp_path / "none.glb")


def test_one_frame_is_enough(tmp_path):
    still = Motion(torch.eye(3).expand(1, 1, 24, 3, 3), torch.tensor([[[1.0, 0.9, 2.0]]]))
    again = load_glb(save_glb(still, tmp_path / "still.glb"))
    torch.testing.assert_close(again.root, still.root)
