"""SMPL arrays lie as AMASS has them, and come back within a millimetre."""

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.export.smpl import J_0, load_smpl, save_smpl
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import axis_angle_to_matrix
from dancediff.motion.skeleton import SMPL24


@pytest.fixture(scope="module")
def group():
    return choreograph(np.arange(0.2, 6, 0.5), dancers=2, seed=2)[0]


def test_a_group_comes_back_from_a_file_each(group, tmp_path):
    first = group.save(tmp_path / "dance.smpl.npz")
    assert first.name == "dance.1.smpl.npz"
    again = Motion.load(*sorted(tmp_path.glob("*.npz")))
    assert (again.num_dancers, again.fps) == (2, 30.0)
    assert (again.joints() - group.joints()).norm(dim=-1).max() < 1e-3


def test_keys_and_shapes_are_those_of_amass(group, tmp_path):
    with np.load(save_smpl(group.dancer(0), tmp_path / "a.npz"), allow_pickle=False) as file:
        amass = {"poses", "trans", "betas", "gender", "mocap_framerate"}
        assert set(file) == amass | {"synthetic"} and file["synthetic"]
        assert file["poses"].shape == (group.num_frames, 156)
        assert file["trans"].shape == (group.num_frames, 3)
        assert (file["mocap_framerate"], str(file["gender"])) == (30.0, "neutral")


def test_a_smpl_body_with_z_up_stands_in_our_places(group, tmp_path):
    """What a viewer does: bend the joints about the pelvis at J_0, then add trans."""
    with np.load(save_smpl(group.dancer(1), tmp_path / "a.npz"), allow_pickle=False) as file:
        poses, trans = torch.from_numpy(file["poses"]), torch.from_numpy(file["trans"])
    R = axis_angle_to_matrix(poses.unflatten(-1, (52, 3))[:, :22])
    place, turn = [torch.tensor(J_0, dtype=torch.float64) + trans], [R[:, 0]]
    for j in range(1, 22):
        p = SMPL24.parents[j]
        place.append(place[p] + turn[p] @ SMPL24.offsets[j].double())
        turn.append(turn[p] @ R[:, j])
    x, y, z = torch.stack(place, dim=1).unbind(-1)
    ours = group.joints()[1, :, :22].double()
    torch.testing.assert_close(torch.stack([x, z, -y], -1), ours, atol=1e-4, rtol=0)


def test_groups_and_other_files_are_refused(group, tmp_path):
    with pytest.raises(ValueError, match=r"motion\.dancer\(k\)"):
        save_smpl(group, tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", poses=np.zeros((4, 156)))
    with pytest.raises(ValueError, match=r"b\.npz.*trans"):
        load_smpl(tmp_path / "b.npz")
    wrong = {"poses": np.zeros((4, 156)), "trans": np.zeros((3, 3)), "mocap_framerate": 30.0}
    np.savez(tmp_path / "c.npz", **wrong)
    with pytest.raises(ValueError, match="do not fit"):
        Motion.load(tmp_path / "c.npz")
    np.savez(tmp_path / "d.npz", **wrong | {"trans": np.full((4, 3), np.nan)})
    with pytest.raises(ValueError, match="not finite"):
        load_smpl(tmp_path / "d.npz")
    with pytest.raises(ValueError, match="fps"):
        np.savez(tmp_path / "e.npz", **wrong | {"trans": np.zeros((4, 3)), "mocap_framerate": 0.0})
        load_smpl(tmp_path / "e.npz")
