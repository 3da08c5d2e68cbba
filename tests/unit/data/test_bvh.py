import time

import pytest
import roma
import torch

from dancediff.data.bvh import read_bvh
from dancediff.export.bvh import save_bvh
from dancediff.motion.motion import Motion

SMALL = """HIERARCHY
ROOT hip
{
    OFFSET 0 0 0
    CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
    JOINT left leg
    {
        OFFSET 10 0 0
        CHANNELS 3 Yrotation Xrotation Zrotation
        End Site
        {
            OFFSET 0 -40 0
        }
    }
}
MOTION
Frames: 2
Frame Time: 0.008333
0 100 0 0 0 0 0 0 0
0 100 0 90 0 0 0 90 0
"""


def motion(f=40, seed=0):
    generator = torch.Generator().manual_seed(seed)
    quats = torch.nn.functional.normalize(torch.randn(f, 24, 4, generator=generator), dim=-1)
    pose = roma.unitquat_to_rotmat(quats)
    return Motion(pose[None], 3 * torch.randn(1, f, 3, generator=generator), 30.0)


def round_trip_error(dance, path):
    bvh = read_bvh(save_bvh(dance, path))
    at = [bvh.index(name) for name in dance.skeleton.names]
    return (bvh.world()[0][:, at] - dance.joints()[0]).norm(dim=-1).max().item()


def test_a_byte_order_mark_is_passed_over(tmp_path):
    """Windows programs put one at the beginning of a text."""
    (tmp_path / "a.bvh").write_text(SMALL, encoding="utf-8-sig")
    assert read_bvh(tmp_path / "a.bvh").names == read_bvh(SMALL).names


def test_places_joints_as_computed_by_hand():
    points, _ = read_bvh(SMALL).world()
    expected = [[[0, 1, 0], [0.1, 1, 0], [0.1, 0.6, 0]], [[0, 1, 0], [0, 1.1, 0], [0, 1.1, -0.4]]]
    # second frame: the leg hangs along -y, X turns it to -z, the hip's Z turn leaves it there
    torch.testing.assert_close(
        points, torch.tensor(expected, dtype=torch.float64), atol=1e-9, rtol=0
    )


def test_names_may_hold_spaces_and_end_sites_get_one():
    bvh = read_bvh(SMALL)
    assert bvh.names == ("hip", "left leg", "left leg_end")
    assert bvh.parents == (-1, 0, 1)


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_turns_in_the_order_of_the_channels(order):
    text = SMALL.replace(
        "Yrotation Xrotation Zrotation", " ".join(f"{axis}rotation" for axis in order)
    ).replace("90 0 0 0 90 0", "0 0 0 10 20 30")
    R = read_bvh(text).rotations[1, 1]
    expected = roma.euler_to_rotmat(order, torch.tensor([10.0, 20, 30]).double(), degrees=True)
    torch.testing.assert_close(R, expected)


def test_position_channels_of_an_inner_joint_replace_its_offset():
    text = SMALL.replace(
        "CHANNELS 3 Yrotation Xrotation Zrotation", "CHANNELS 3 Zposition Xposition Xrotation"
    )
    bvh = read_bvh(text.replace("90 0 0 0 90 0", "0 0 0 7 3 0"))
    torch.testing.assert_close(bvh.translations[1, 1], torch.tensor([0.03, 0, 0.07]).double())


def test_frame_rate_comes_from_the_header_unless_given():
    assert read_bvh(SMALL).fps == pytest.approx(120, abs=0.01)
    assert read_bvh(SMALL, fps=60).fps == 60


def test_scale_is_the_files_unit():
    assert read_bvh(SMALL, scale=0.0254).root[0, 1].item() == pytest.approx(2.54)


def test_reads_braces_on_the_joints_line_and_dos_line_ends():
    text = SMALL.replace("\n{", " {").replace("\n", "\r\n")
    torch.testing.assert_close(read_bvh(text).world()[0], read_bvh(SMALL).world()[0])


def test_round_trip_is_within_a_millimetre(tmp_path):
    assert round_trip_error(motion(), tmp_path / "a.bvh") < 1e-3
    assert round_trip_error(motion(seed=1), tmp_path / "b.bvh") < 1e-3


def test_round_trip_holds_where_euler_angles_are_not_unique(tmp_path):
    dance = motion()
    quarter = roma.euler_to_rotmat("ZXY", torch.tensor([0.3, torch.pi / 2, 0.2]))
    dance.pose[:] = quarter
    assert round_trip_error(dance, tmp_path / "a.bvh") < 1e-3


def test_writes_one_dancer_and_leaves_nothing_else(tmp_path):
    save_bvh(motion(), tmp_path / "a.bvh")
    assert [path.name for path in tmp_path.iterdir()] == ["a.bvh"]
    two = Motion(torch.eye(3).expand(2, 5, 24, 3, 3), torch.zeros(2, 5, 3))
    with pytest.raises(ValueError, match=r"2 dancers.*dancer\(k\)"):
        save_bvh(two, tmp_path / "b.bvh")
    assert not (tmp_path / "b.bvh").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("HIERARCHY", "HIERARCHIE", "HIERARCHY should stand|where HIERARCHY"),
        ("OFFSET 10 0 0", "OFFSET 10 0", "OFFSET 10 0'"),
        ("OFFSET 10 0 0", "OFFSET 10 0 nan", "three numbers"),
        ("OFFSET 10 0 0\n", "\n", "OFFSET of 'left leg'"),
        ("CHANNELS 3", "CHANNELS 4", "CHANNELS 4"),
        ("3 Yrotation Xrotation", "3 Yrotation Yrotation", "different names"),
        ("Xrotation Zrotation", "Xrotation Wrotation", "Wrotation"),
        ("left leg", "hip", "two joints called 'hip'"),
        ("Frames: 2", "Frames: 3", "3 frames of 9 channels but holds 18"),
        ("Frames: 2", "Frames: 1e300", "holds 18"),
        ("Frames: 2", "Frames: -2", "-2 frames"),
        ("Frame Time: 0.008333", "Frame Time: 0", "frame rate 0"),
        ("Frame Time: 0.008333", "Frame Time: 1e9", "pass the true one as fps="),
        ("0 100 0 90", "0 100 0 x", "something else than numbers"),
        ("0 100 0 90", "0 100 0 inf", "not finite"),
        ("MOTION", "", "MOTION"),
    ],
)
def test_says_what_is_wrong(old, new, message):
    with pytest.raises(ValueError, match=message):
        read_bvh(SMALL.replace(old, new, 1))


def test_a_cut_file_is_refused():
    with pytest.raises(ValueError, match="cut off"):
        read_bvh(SMALL[: SMALL.index("}")])


@pytest.mark.parametrize("arguments", [{"fps": 0}, {"fps": float("nan")}, {"scale": 0}])
def test_refuses_arguments_without_sense(arguments):
    with pytest.raises(ValueError, match=r"fps|scale"):
        read_bvh(SMALL, **arguments)


def test_a_missing_file_is_an_os_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_bvh(tmp_path / "none.bvh")


def test_depth_is_no_limit():
    deep = 3000
    joints = "".join(f"JOINT j{k} {{ OFFSET 0 1 0\n" for k in range(deep))
    text = "HIERARCHY\nROOT r {\nOFFSET 0 0 0\nCHANNELS 1 Yrotation\n" + joints + "}\n" * (deep + 1)
    start = time.process_time()
    bvh = read_bvh(text + "MOTION\nFrames: 1\nFrame Time: 0.1\n0\n")
    assert bvh.rest()[-1, 1].item() == pytest.approx(deep * 0.01)
    assert time.process_time() - start < 5


def test_a_header_without_a_space_is_read():
    text = SMALL.replace("Frames: 2", "Frames:2").replace("Time: 0", "Time:0")
    assert read_bvh(text).num_frames == 2 and read_bvh(text).fps == read_bvh(SMALL).fps
