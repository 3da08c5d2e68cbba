"""Our BVH reader against two others: the package pybvh, and rotations from scipy."""

import os

import numpy as np
import pytest
import roma
import torch
from scipy.spatial.transform import Rotation

from dancediff.data.bvh import read_bvh
from dancediff.export.bvh import save_bvh
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import SMPL24


@pytest.fixture
def written(tmp_path):
    generator = torch.Generator().manual_seed(3)
    quats = torch.nn.functional.normalize(torch.randn(30, 24, 4, generator=generator), dim=-1)
    dance = Motion(roma.unitquat_to_rotmat(quats)[None], torch.randn(1, 30, 3, generator=generator))
    return dance, save_bvh(dance, tmp_path / "dance.bvh")


def imported():
    """The package, which must be there where DANCEDIFF_REQUIRE says so."""
    if "pybvh" in os.environ.get("DANCEDIFF_REQUIRE", ""):
        import pybvh

        return pybvh
    return pytest.importorskip("pybvh")


def pybvh_error(path, scale=0.01) -> float:
    """Largest distance between pybvh's joints and ours, metres."""
    pybvh = imported()
    theirs = pybvh.read_bvh_file(str(path))
    ours = read_bvh(path, scale=scale)
    columns = [theirs.node_index[name] for name in theirs.joint_names]
    theirs_at = scale * theirs.node_positions()[:, columns]
    ours_at = ours.world()[0][:, [ours.index(name) for name in theirs.joint_names]].numpy()
    return np.abs(theirs_at - ours_at).max()


@pytest.mark.filterwarnings("ignore:Rest pose suggests:UserWarning")  # random poses have no up
def test_pybvh_reads_what_we_write(written):
    dance, path = written
    assert pybvh_error(path) < 1e-6
    pybvh = imported()
    theirs = pybvh.read_bvh_file(str(path))
    columns = [theirs.node_index[name] for name in SMPL24.names]
    at = 0.01 * theirs.node_positions()[:, columns]
    assert np.abs(at - dance.joints()[0].numpy()).max() < 1e-3


@pytest.mark.parametrize("name", ["salsa/10.bvh", "indian/15.bvh"])
def test_pybvh_reads_real_motion_as_we_do(real_data, name):
    if not (real_data / "cmu" / name).is_file():
        pytest.skip(f"no {name} in the real data")
    assert pybvh_error(real_data / "cmu" / name) < 1e-6


def scipy_joints(text: str) -> np.ndarray:
    """Joints of a BVH whose every joint has a fixed order, by recursion over its own tokens."""
    head, _, tail = text.partition("MOTION")
    words = iter(head.split()[1:])
    frames = np.array([line.split() for line in tail.strip().splitlines()[2:]], float)
    column = 0
    found = []

    def joint(parent, turn):
        nonlocal column
        assert next(words) == "{"
        place = parent
        for word in words:
            if word == "OFFSET":
                place = parent + turn @ np.array([float(next(words)) for _ in range(3)])
            elif word == "CHANNELS":
                names = [next(words) for _ in range(int(next(words)))]
                values = frames[:, column : column + len(names)]
                column += len(names)
                if len(names) == 6:
                    place, names, values = values[:, :3], names[3:], values[:, 3:]
                order = "".join(name[0] for name in names)
                turn = turn @ Rotation.from_euler(order, values, degrees=True).as_matrix()
                found.append(place)
            elif word in ("JOINT", "End"):
                next(words)
                joint(place, turn)
            elif word == "}":
                return

    next(words), next(words)
    joint(np.zeros((len(frames), 3)), np.tile(np.eye(3), (len(frames), 1, 1)))
    return np.stack(found, 1)


def test_scipy_places_every_joint_where_we_do(written):
    _, path = written
    ours = read_bvh(path, scale=1.0)
    named = [j for j, name in enumerate(ours.names) if not name.endswith("_end")]
    assert np.abs(scipy_joints(path.read_text()) - ours.world()[0][:, named].numpy()).max() < 1e-6
