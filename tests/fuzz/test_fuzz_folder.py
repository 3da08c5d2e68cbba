"""Broken files for `prepare folder`: nothing but ValueError, no hang, no memory for nothing."""

import numpy as np
import pytest
from fuzzing import fuzz, mutated, num_inputs, put

from dancediff.data.choreographer import choreograph
from dancediff.data.folder.make import read_file
from dancediff.data.folder.posture import Given
from dancediff.motion.rotation import matrix_to_axis_angle


@pytest.fixture(scope="module")
def motion():
    return choreograph(np.arange(0.2, 3, 0.5), dancers=1, seed=1, seconds=3)[0].frames(0, 12)


def read_all(path):
    def read(given):
        put(path, given)
        assert len(read_file(path, Given())) == 1

    return read


def test_foreign_gltf(motion, tmp_path, record_property):
    pytest.importorskip("pygltflib")
    path = motion.save(tmp_path / "a.glb")
    content = path.read_bytes()
    head = 20 + int.from_bytes(content[12:16], "little")
    out = fuzz(read_all(path), mutated(content, num_inputs(300), head=head))
    record_property("trust", f"fuzz, glTF of other programs: {out}")
    assert out.refused > 0.2 * out.tried and out.read > 0


def test_bvh_whose_skeleton_is_found_out(motion, tmp_path, record_property):
    path = motion.save(tmp_path / "a.bvh")
    out = fuzz(read_all(path), mutated(path.read_bytes(), num_inputs(300), head=4000))
    record_property("trust", f"fuzz, BVH with joints to be found: {out}")
    assert out.refused > 0.2 * out.tried and out.read > 0


def test_compressed_smpl(motion, tmp_path, record_property):
    path = tmp_path / "a.npz"
    poses = matrix_to_axis_angle(motion.pose[0]).flatten(1).numpy()
    np.savez_compressed(path, poses=poses, trans=motion.root[0].numpy(), fps=30.0)
    out = fuzz(read_all(path), mutated(path.read_bytes(), num_inputs(300)))
    record_property("trust", f"fuzz, compressed SMPL .npz: {out}")
    assert out.refused > 0.2 * out.tried


def test_an_npz_that_unpacks_into_very_much_is_refused(tmp_path):
    np.savez_compressed(tmp_path / "bomb.npz", poses=np.zeros((2**20, 66)))  # 0.5 MB hold 0.5 GB
    with pytest.raises(ValueError, match="larger than the file"):
        read_file(tmp_path / "bomb.npz", Given())
