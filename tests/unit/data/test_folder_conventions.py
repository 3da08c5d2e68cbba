"""One real take as five programs write it goes through `prepare folder` without a map."""

from dataclasses import replace

import pytest

from dancediff.cli import main
from dancediff.data.bvh import read_bvh
from dancediff.data.folder.make import make_folder_take, read_file
from dancediff.data.folder.posture import Given, settle
from dancediff.data.folder.takes import TakePlan
from dancediff.data.prepared import PreparedData
from dancediff.data.retarget import retarget
from recordings import ASF, BLENDER, DAZ, MIXAMO, ROKOKO, UNNAMED, in_convention, write_bvh

WRITTEN = {
    "asf": ASF, "blender": BLENDER, "daz": DAZ, "mixamo": MIXAMO, "rokoko": ROKOKO,
    "unnamed": UNNAMED,
}  # fmt: skip
TEN = [(name, part) for name in WRITTEN for part in (0, 1)][:10]
PARTS = (slice(560, 800), slice(1450, 1690))  # frames at 60 a second; nothing is broken there
BROKEN = {
    "cut.bvh": (lambda text: text[: len(text) // 2], "correct 'Frames:'"),
    "hat.bvh": (lambda text: HAT, "which joint is which cannot be found"),
    "words.bvh": (lambda text: text.replace("Frames: 240", "Frames: many"), "'Frames:'"),
}
HAT = """HIERARCHY
ROOT hat
{
OFFSET 0 0 0
CHANNELS 3 Zrotation Xrotation Yrotation
End Site
{
OFFSET 0 1 0
}
}
MOTION
Frames: 1
Frame Time: 0.04
0 0 0
"""


def settled(motion):
    """Joints with the middle of the take at the origin."""
    joints = motion.joints()[0]
    return joints - motion.root[0].mean(0) * joints.new_tensor([1.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def take(real_data):
    return read_bvh(real_data / "cmu" / "salsa" / "06.bvh", fps=60)


@pytest.fixture(scope="module")
def folder(take, tmp_path_factory):
    """The prepared folder, and its source with ten good files and three broken ones."""
    src, out = tmp_path_factory.mktemp("motion"), tmp_path_factory.mktemp("out")
    for name, part in TEN:
        convention = WRITTEN[name]
        piece = take.frames(PARTS[part].start, PARTS[part].stop)
        path = src / f"{name}_{part}.bvh"
        write_bvh(path, in_convention(piece, convention), moved=convention.moved)
    good = (src / "daz_0.bvh").read_text()
    for name, (spoil, _) in BROKEN.items():
        (src / name).write_text(spoil(good))
    assert main(["prepare", "folder", str(src), str(out)]) == 0
    return src, out


def test_ten_files_of_five_conventions_agree_within_two_centimetres(take, folder):
    data = PreparedData(folder[1])
    assert {entry.name for entry in data} == {f"{name}_{part}" for name, part in TEN}
    for name, part in TEN:
        reference = settled(retarget(take.frames(PARTS[part].start, PARTS[part].stop), "cmu")[0])
        joints = settled(data.load(f"{name}_{part}").motion)
        f = min(len(joints), len(reference))
        assert f >= len(reference) - 1
        off = (joints[:f] - reference[:f]).norm(dim=-1)
        assert off.max() < 0.02, (name, part, off.max())


def test_what_was_found_is_told(folder):
    data = PreparedData(folder[1])
    found = {entry.name: entry.notes["skeletons"][0] for entry in data}
    for name, convention in WRITTEN.items():
        if f"{name}_0" in found:
            facts = found[f"{name}_0"]
            assert facts["up"] == convention.up and facts["fps"] == convention.fps
            assert facts["unit"] == pytest.approx(convention.unit, rel=1e-3)
            assert (facts["rest"] == "file") == (convention.rest == "kept")
    doubts = {entry.name: " ".join(entry.notes["doubts"]) for entry in data}
    assert "guessed" in doubts["blender_0"] and not doubts["daz_0"]
    repaired = {entry.name: " ".join(entry.notes["repaired"]) for entry in data}
    assert "its rest pose is no upright body; that of frame 0 is taken" in repaired["asf_0"]
    assert "the first 0.008 s are left out" in repaired["asf_0"]


def test_no_upright_pose_at_all_is_told(take):
    crooked = in_convention(take.frames(300, 540), ASF)
    found = settle(crooked.frames(1), Given())
    assert any("no frame is a T-pose" in doubt for doubt in found.doubts)


def test_broken_files_are_refused_by_name(folder):
    skipped = {row["name"]: row["reason"] for row in PreparedData(folder[1]).skipped}
    assert len(skipped) == 3
    report = (folder[1] / "report.md").read_text()
    for file, (_, words) in BROKEN.items():
        reason = skipped[file.removesuffix(".bvh")]
        assert file in reason and words in reason
        assert f"| {file} |  | refused |" in report


def test_every_take_has_a_picture(folder):
    for name, part in TEN:
        assert (folder[1] / "pictures" / f"{name}_{part}.png").read_bytes()[:4] == b"\x89PNG"


def test_a_checked_table_is_used_and_kept(folder, tmp_path, capsys):
    src, out = tmp_path / "src", tmp_path / "out"
    src.mkdir()
    (src / "a.bvh").write_bytes((folder[0] / "blender_0.bvh").read_bytes())
    assert main(["prepare", "folder", str(src), str(out)]) == 0
    settings = out / "folder.toml"
    text = settings.read_text().replace("checked = false", "checked = true")
    settings.write_text(text.replace("fps = 24.0", "fps = 48.0"))
    assert main(["prepare", "folder", str(src), str(out)]) == 0
    (entry,) = PreparedData(out)
    assert entry.notes["doubts"] == [] and entry.notes["skeletons"][0]["fps"] == 48
    assert entry.frames == pytest.approx(61, abs=2)  # half of 4 s
    assert "checked = true" in settings.read_text() and "fps = 48.0" in settings.read_text()
    capsys.readouterr()
    assert main(["prepare", "folder", str(src), str(out)]) == 0
    assert "made 0, kept 1" in capsys.readouterr().out


def test_a_t_pose_put_before_the_take_is_left_out(take, real_data):
    (found,) = read_file(real_data / "cmu" / "salsa" / "06.bvh", Given(fps=60.0))
    assert 1 <= found.lead <= 15 and found.bvh.num_frames == take.num_frames
    later = settle(read_bvh(real_data / "cmu" / "salsa" / "06.bvh", scale=1).frames(100), Given())
    assert later.lead == 0


def test_partners_stay_in_step(real_data, tmp_path):
    """Whatever is cut from one of them is cut from both."""
    salsa = [real_data / "cmu" / "salsa" / name for name in ("06.bvh", "21.bvh")]
    plan = TakePlan("duo", tuple(salsa), labels=("a", "b"))
    take = make_folder_take(plan, (Given(fps=60.0),) * 2, pictures=None)
    alone = [read_file(path, Given(fps=60.0))[0] for path in salsa]
    assert len({one.lead for one in alone}) == 2
    lead = max(one.lead for one in alone) // 2
    f = take.num_frames - 1
    hips = [one.bvh.world()[0][2 * lead :: 2, one.bvh.index("hip")][:f] for one in alone]
    apart = (hips[0] - hips[1]).norm(dim=-1).float()
    root = take.motion.root[:, :f]
    off = (root[0] - root[1]).norm(dim=-1) - apart
    steady = off - off.mean()  # pelvis and hip are not the same joint
    assert steady.abs().mean() < 0.02


def test_exchanged_sides_are_told(take):
    swap = {"l": "r", "r": "l"}
    names = [swap[n[0]] + n[1:] if n[0] in swap and n[1:2].isupper() else n for n in take.names]
    found = settle(replace(take, names=tuple(names)), Given(unit=1.0))
    assert any("exchanged" in doubt for doubt in found.doubts)


@pytest.mark.parametrize(
    ("seconds", "fps"),
    [(0.033367, 29.97), (0.0166833, 59.94), (0.0417083, 23.976), (0.033, 30), (0.0333, 30)],
)
def test_rates_of_video_stay_and_rounded_ones_are_mended(take, seconds, fps):
    found = settle(replace(take.frames(600, 640), fps=1 / seconds), Given(unit=1.0))
    assert found.facts["fps"] == pytest.approx(fps, rel=1e-4)
