"""What other papers' code writes is read as the dance that it is, or refused with a reason."""

import json
import pickle

import numpy as np
import pytest
import torch

from dancediff.cli import main
from dancediff.data.choreographer import choreograph
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import matrix_to_axis_angle, matrix_to_rot6d, rotation_about

ONE, GROUP = 1, 3


@pytest.fixture(scope="module")
def group():
    return choreograph(np.arange(0.2, 3, 0.5), dancers=GROUP, seed=5, seconds=3)[0]


@pytest.fixture(scope="module")
def solo(group):
    return group.dancer(0)


def lying(motion: Motion) -> Motion:
    """The dance with z up, as EDGE and TCDiff write theirs."""
    turn = rotation_about("x", torch.tensor(torch.pi / 2))
    pose = motion.pose.clone()
    pose[:, :, 0] = turn @ pose[:, :, 0]
    return Motion(pose, motion.root @ turn.T)


def vectors(motion: Motion) -> np.ndarray:
    return matrix_to_axis_angle(motion.pose).flatten(2).numpy()


def edge(motion):
    motion = lying(motion)
    full = motion.joints()[0].numpy()
    return {
        "smpl_poses": vectors(motion)[0],
        "smpl_trans": motion.root[0].numpy(),
        "full_pose": full,
    }


def tcdiff(motion, order=(1, 0, 2)):
    """Rows of all dancers of a frame, then the next frame."""
    motion = lying(motion)
    rows, path = vectors(motion).transpose(order), motion.root.numpy().transpose(order)
    return {
        "smpl_poses": rows.reshape(-1, 72),
        "smpl_trans": path.reshape(-1, 3),
        "full_pose": motion.joints().numpy(),
    }


def gcd(motion):
    return {"smpl_poses": vectors(motion), "root_trans": motion.root.numpy()}


def lodge(motion):
    return motion.features("lodge")[0].numpy()


def finedance(motion):
    rows = np.zeros((motion.num_frames, 315), dtype=np.float32)
    rows[:, :3] = motion.root[0] / 1.038  # the legs of its bodies are shorter
    rows[:, 3:135] = matrix_to_rot6d(motion.pose[0, :, :22]).flatten(1)
    return rows


def write(path, content):
    if path.suffix == ".npy":
        np.save(path, content)
    else:
        path.write_bytes(pickle.dumps(content))
    return path


@pytest.mark.parametrize(
    ("name", "content", "dancers"),
    [
        ("edge.pkl", edge, ONE),
        ("tcdiff.pkl", tcdiff, GROUP),
        ("by_dancer.pkl", lambda motion: tcdiff(motion, (0, 1, 2)), GROUP),
        ("gcd.pkl", gcd, GROUP),
        ("lodge.npy", lodge, ONE),
        ("wide.npy", lambda motion: motion.features().numpy(), GROUP),
        ("finedance.npy", finedance, ONE),
        ("positions.npy", lambda motion: lying(motion).joints()[0].numpy(), ONE),
        ("positions_of_all.npy", lambda motion: motion.joints().numpy(), GROUP),
    ],
)
def test_the_dance_is_the_one_that_was_written(solo, group, tmp_path, name, content, dancers):
    dance = solo if dancers == ONE else group
    read = Motion.load(write(tmp_path / name, content(dance)))
    assert read.num_dancers == dancers and read.num_frames == dance.num_frames and read.fps == 30
    raised = read.joints() - dance.joints()  # floors may be found a little higher or lower
    assert raised[..., (0, 2)].abs().max() < 1e-3
    assert raised[..., 1].abs().max() < 0.03
    level = raised[..., 1].flatten(1)
    assert (level.max(1).values - level.min(1).values).max() < 1e-3


def test_a_folder_of_them_is_evaluated_and_prepared(solo, group, tmp_path, capsys):
    write(tmp_path / "a.pkl", edge(solo))
    write(tmp_path / "b.npy", lodge(solo))
    write(tmp_path / "c.pkl", gcd(group))
    assert main(["evaluate", str(tmp_path), "--json", "--workers", "1"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert rows["skipped"] == {}
    assert main(["prepare", "folder", str(tmp_path), str(tmp_path / "out")]) == 0
    assert "made 3" in capsys.readouterr().out


def test_amass_with_smplx_names_and_compressed_files(solo, tmp_path):
    solo.save(tmp_path / "a.smpl.npz")
    arrays = dict(np.load(tmp_path / "a.smpl.npz"))
    arrays["mocap_frame_rate"] = arrays.pop("mocap_framerate") * 4
    np.savez_compressed(tmp_path / "smplx.npz", **arrays)
    read = Motion.load(tmp_path / "smplx.npz")
    assert read.fps == 120
    assert torch.allclose(read.joints(), solo.joints(), atol=1e-4)
    solo.save(tmp_path / "own.npz")
    np.savez_compressed(tmp_path / "small.npz", **dict(np.load(tmp_path / "own.npz")))
    assert torch.equal(
        Motion.load(tmp_path / "small.npz").pose, Motion.load(tmp_path / "own.npz").pose
    )
    assert main(["evaluate", str(tmp_path / "small.npz"), "--json", "--workers", "1"]) == 0


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.npy", np.zeros((9, 35)), r"shape \(9, 35\), not \(f, 139\), \(f, 151\)"),
        ("b.npy", np.zeros((9, 139)), "undo the network's normalisation"),
        ("c.npy", np.full((9, 139), np.nan), "not finite"),
        ("d.npy", np.array([{}], dtype=object), "object"),
        ("e.pkl", {"poses": np.zeros((9, 72))}, "lacks trans"),
        ("f.pkl", print, "names 'builtins print'"),
    ],
)
def test_what_is_no_dance_says_why(tmp_path, capsys, name, content, words):
    path = write(tmp_path / name, content)
    with pytest.raises(ValueError, match=words):
        Motion.load(path)
    assert main(["evaluate", str(path), "--workers", "1"]) == 2
    assert name in capsys.readouterr().err


def test_a_group_whose_paths_are_not_its_own_is_refused(group, tmp_path):
    content = tcdiff(group)
    content["smpl_trans"] = content["smpl_trans"] + 1
    with pytest.raises(ValueError, match="dancers are mixed"):
        Motion.load(write(tmp_path / "a.pkl", content))


def test_an_npz_of_something_else_names_the_command(tmp_path):
    np.savez(tmp_path / "a.npz", smpl_poses=np.zeros((9, 72)), smpl_trans=np.zeros((9, 3)))
    with pytest.raises(ValueError, match="no header; other files are read by `dancediff prepare"):
        Motion.load(tmp_path / "a.npz")
