"""A .glb is valid, shows what the motion does, and comes back within a millimetre."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.export.gltf import load_glb, save_glb
from dancediff.export.solids import body_solids
from dancediff.motion.motion import Motion
from dancediff.viz.palette import dancer_color

pygltflib = pytest.importorskip("pygltflib")
TOOLS = Path(__file__).parents[1] / "js"
VALIDATOR = TOOLS / "node_modules" / "gltf-validator"
REQUIRED = "node" in os.environ.get("DANCEDIFF_REQUIRE", "")


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.2, 6, 0.5), dancers=3, seed=1)[0]


@pytest.fixture(scope="module")
def path(dance, tmp_path_factory):
    return save_glb(dance, tmp_path_factory.mktemp("glb") / "dance.glb")


def test_comes_back_within_a_millimetre(dance, path):
    again = Motion.load(path)
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
def test_khronos_validator_has_nothing_to_say(path):
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
