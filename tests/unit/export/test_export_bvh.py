"""What `save_bvh` wrote comes back as a Motion; other trees are sent elsewhere."""

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.export.bvh import load_bvh, save_bvh
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import SMPL24


@pytest.fixture(scope="module")
def group():
    return choreograph(np.arange(0.2, 6, 0.5), dancers=3, seed=2)[0]


def test_a_group_comes_back_from_a_file_each(group, tmp_path):
    assert group.save(tmp_path / "dance.bvh").name == "dance.1.bvh"
    files = sorted(tmp_path.iterdir())
    assert [file.name for file in files] == [f"dance.{k}.bvh" for k in (1, 2, 3)]
    again = Motion.load(*files)
    assert (again.num_dancers, again.fps, again.skeleton) == (3, 30.0, SMPL24)
    assert (again.joints() - group.joints()).norm(dim=-1).max() < 1e-3


def test_a_solo_is_one_file(group, tmp_path):
    assert group.dancer(0).save(tmp_path / "solo.bvh") == tmp_path / "solo.bvh"


def test_other_trees_are_sent_to_prepare_folder(group, tmp_path):
    path = save_bvh(group.dancer(0), tmp_path / "a.bvh")
    path.write_text(path.read_text().replace("JOINT lknee", "JOINT LeftLeg"))
    with pytest.raises(ValueError, match=r"LeftLeg.*prepare folder"):
        load_bvh(path)


def test_another_body_keeps_its_bones(group, tmp_path):
    path = save_bvh(group.dancer(0), tmp_path / "a.bvh")
    path.write_text(path.read_text().replace("OFFSET 4.345142", "OFFSET 9.345142"))
    assert load_bvh(path).skeleton.offsets[4, 0].item() == pytest.approx(0.09345142)


def test_dances_that_do_not_fit_are_not_put_side_by_side(group):
    with pytest.raises(ValueError, match="num_frames"):
        Motion.side_by_side([group, group.frames(0, 10)])


def test_a_damaged_file_is_named(tmp_path):
    (tmp_path / "a.bvh").write_text("HIERARCHY\nROOT\n")
    with pytest.raises(ValueError, match=r"a\.bvh: BVH has 'ROOT'"):
        load_bvh(tmp_path / "a.bvh")


def test_other_bones_stay_in_the_files_that_keep_joints(group, tmp_path):
    path = save_bvh(group.dancer(0), tmp_path / "a.bvh")
    path.write_text(path.read_text().replace("OFFSET 4.345142", "OFFSET 9.345142"))
    other = load_bvh(path)
    for suffix in (".npz", ".glb"):
        again = Motion.load(other.save(tmp_path / f"b{suffix}"))
        torch.testing.assert_close(again.joints(), other.joints(), atol=1e-4, rtol=0)
    with pytest.raises(ValueError, match="bones of other lengths"):
        Motion.side_by_side([group.dancer(1), other])


def test_files_of_ten_dancers_lie_in_their_order_by_name(group, tmp_path):
    ten = Motion.side_by_side([group.dancer(k % 2) for k in range(10)])
    ten.save(tmp_path / "dance.bvh")
    names = sorted(path.name for path in tmp_path.glob("*.bvh"))
    assert names[0] == "dance.01.bvh" and names[-1] == "dance.10.bvh"
