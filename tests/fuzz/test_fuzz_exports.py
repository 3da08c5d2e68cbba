"""Broken .glb and SMPL files: nothing but ValueError, no hang, no memory for what is not there."""

import pytest
import torch
from fuzzing import fuzz, mutated, num_inputs, put

from dancediff.export.smpl import load_smpl, save_smpl
from dancediff.motion.motion import Motion


@pytest.fixture(scope="module")
def motion():
    pose = torch.eye(3).expand(1, 2, 24, 3, 3)
    return Motion(pose, torch.ones(1, 2, 3))


def test_glb(motion, tmp_path, record_property):
    gltf = pytest.importorskip("dancediff.export.gltf")
    pytest.importorskip("pygltflib")
    path = gltf.save_glb(motion, tmp_path / "a.glb", body="mannequin")
    whole = path.read_bytes()

    def read(given):
        put(path, given)
        assert gltf.load_glb(path).num_frames < 10_000

    out = fuzz(read, mutated(whole, num_inputs()))
    record_property("trust", f"fuzz, .glb: {out}")
    assert out.read > 0.01 * out.tried
    assert out.refused > 0.2 * out.tried


def test_smpl(motion, tmp_path, record_property):
    path = save_smpl(motion, tmp_path / "a.npz")
    whole = path.read_bytes()

    def read(given):
        put(path, given)
        assert load_smpl(path).num_frames < 10_000

    out = fuzz(read, mutated(whole, num_inputs()))
    record_property("trust", f"fuzz, SMPL .npz: {out}")
    assert out.refused > 0.2 * out.tried
