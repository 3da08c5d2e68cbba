"""Which files hold dances."""

import pytest
import torch

from dancediff.io import dance_files
from dancediff.motion.motion import Motion


@pytest.fixture
def pair():
    return Motion(torch.eye(3).expand(2, 3, 24, 3, 3), torch.zeros(2, 3, 3))


def test_a_dance_in_several_formats_counts_once(pair, tmp_path):
    for name in ("a.npz", "a.bvh", "a.smpl.npz", "b.bvh", "b.smpl.npz", "c.bvh"):
        pair.save(tmp_path / name)
    (tmp_path / ".half").mkdir()
    pair.save(tmp_path / ".half" / "d.npz")
    (tmp_path / "song.wav").touch()
    with pytest.warns(UserWarning, match="count as solos") as told:
        names = [path.name for path in dance_files(tmp_path)]
    solos = ["b.1.smpl.npz", "b.2.smpl.npz", "c.1.bvh", "c.2.bvh"]
    assert names == ["a.npz", *solos]
    assert "`dancediff convert c.1.bvh c.2.bvh dance.npz`" in str(told[1].message)


@pytest.mark.parametrize("kind", [".bvh", ".smpl.npz"])
@pytest.mark.parametrize("larger", [5, 10])
def test_a_smaller_group_leaves_no_dancer_of_a_larger_one(pair, kind, larger, tmp_path):
    others = [f"dance.old.1{kind}", f"dancer.3{kind}", f"a.dance.3{kind}", "dance.3.html"]
    for name in others:
        (tmp_path / name).touch()
    Motion.side_by_side([pair.dancer(0)] * larger).save(tmp_path / f"dance{kind}")
    pair.save(tmp_path / f"dance{kind}")
    new = {f"dance.1{kind}", f"dance.2{kind}"}
    assert {path.name for path in tmp_path.iterdir()} == new | set(others)


def test_a_dancer_who_is_saved_alone_costs_no_other(pair, tmp_path):
    for name in ("dance.1.bvh", "dance.2.bvh", "dance.bvh"):
        pair.dancer(0).save(tmp_path / name)
    assert len(list(tmp_path.iterdir())) == 3


def test_dances_of_the_same_name_in_two_folders_are_two(pair, tmp_path):
    for folder in ("x", "y"):
        (tmp_path / folder).mkdir()
        pair.save(tmp_path / folder / "dance.npz")
    assert len(dance_files(tmp_path)) == 2


def test_what_is_no_dance_is_named(pair, tmp_path):
    with pytest.raises(ValueError, match=r"nowhere' does not exist"):
        dance_files(tmp_path / "nowhere")
    with pytest.raises(ValueError, match=r"holds no dance \(\.npz \.glb"):
        dance_files(tmp_path)
    pair.save(tmp_path / "dance.png")
    with pytest.raises(ValueError, match=r"dance\.png' is no dance that can be read"):
        dance_files(tmp_path / "dance.png")


@pytest.mark.parametrize("name", ["a.npz", "a.glb", "a.bvh", "a.smpl.npz", "a.png"])
def test_a_dance_with_nan_is_not_written(pair, name, tmp_path):
    pair.root[0, 1, 2] = float("nan")
    with pytest.raises(ValueError, match="not finite"):
        pair.save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_suffixes_in_capitals_are_read(pair, tmp_path):
    pair.dancer(0).save(tmp_path / "a.bvh").rename(tmp_path / "A.BVH")
    assert dance_files(tmp_path) == dance_files(tmp_path / "A.BVH") == [tmp_path / "A.BVH"]
    assert Motion.load(tmp_path / "A.BVH").num_frames == 3


def test_a_folder_with_an_index_of_its_own_is_searched(pair, tmp_path):
    pair.save(tmp_path / "a.npz")
    (tmp_path / "index.json").write_text('{"videos": []}')
    assert dance_files(tmp_path) == [tmp_path / "a.npz"]
