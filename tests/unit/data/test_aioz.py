import importlib.util
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch

from dancediff.data.aioz import aioz_jobs
from dancediff.data.choreographer import choreograph
from dancediff.data.prepare import prepare
from dancediff.data.prepared import PreparedData
from dancediff.motion.rotation import matrix_to_axis_angle
from dancediff.music.song import Music
from dancediff.music.synth import synth_song
from places import DATA_PREP

SEQ = "{}_0_0_150"
BIG = "aioz_b_0_0_150"
RAISED = 1.3  # metres between the floor of the files and ours


@pytest.fixture(scope="module")
def dance():
    """Seven people for five seconds, and the song."""
    song, truth = synth_song(3, seconds=5)
    groups = [choreograph(truth.beats, dancers=n, seed=1, seconds=5)[0] for n in (4, 3)]
    pose = torch.cat([group.pose for group in groups])
    root = torch.cat([group.root for group in groups])
    return pose[:, :150], root[:, :150], song


def content(dance, dancers: int, *, frames: int = 150, dtype=np.float64) -> dict:
    """What a file of the data set holds."""
    pose, root = dance[0][:dancers, :frames], dance[1][:dancers, :frames]
    raised = root + torch.tensor([0.0, RAISED, 0.0])
    return {
        "smpl_poses": matrix_to_axis_angle(pose).flatten(-2).numpy().astype(dtype),
        "root_trans": raised.numpy().astype(dtype),
        "smpl_betas": np.zeros((dancers, 10)),
        "meta": {"orig_start": 0, "orig_end": frames},
    }


class Data:
    """A folder in the layout of AIOZ-GDance."""

    def __init__(self, path: Path, song: Music):
        self.path, self.song, self.lists = path, song, {"train": [], "val": [], "test": []}
        for folder in ("motions_smpl", "musics"):
            (path / folder).mkdir()
        self.write_lists()

    def write_lists(self):
        for split, names in self.lists.items():
            text = "".join(f"{name}\n" for name in names)
            (self.path / f"{split}_split_sequence_names.txt").write_text(text)

    def add(self, video: str, value, *, split: str | None = "train", music=True, protocol=4):
        name = video if "_" in video else SEQ.format(video)
        raw = value if isinstance(value, bytes) else pickle.dumps(value, protocol)
        (self.path / "motions_smpl" / f"{name}.pkl").write_bytes(raw)
        if music:
            song = self.song if music is True else music
            song.save(self.path / "musics" / f"{name}.wav")
        if split:
            self.lists[split].append(name)
            self.write_lists()
        return name

    def make(self, name: str):
        return next(job for job in aioz_jobs(self.path) if job.name == f"aioz_{name}").make()


@pytest.fixture
def data(tmp_path, dance):
    return Data(tmp_path, dance[2])


def test_a_take_comes_back_with_its_floor_at_zero(data, dance):
    take = data.make(data.add("zEB5-zAz_89qg_37_0_150", content(dance, 3)))
    assert take.motion.num_dancers == 3 and take.motion.fps == 30
    expected = dance[1][:3]
    gap = (take.motion.root - expected).abs()
    assert gap[..., (0, 2)].max() < 1e-4
    assert gap[..., 1].max() < 0.02
    assert np.allclose(take.notes["floors"], RAISED, atol=0.02)
    assert (take.motion.pose - dance[0][:3]).abs().max() < 1e-4
    assert 0.2 < take.motion.contact.mean() < 1
    assert (take.kind, take.music, take.split) == ("real", "original", "train")
    assert "non-commercial" in take.licence
    assert take.notes["video"] == "zEB5-zAz_89qg"
    heard = Music.load(data.path / "musics" / take.notes["song"])
    assert take.M.equal(heard.features()[:150])
    assert np.allclose(take.beats, heard.beats()[heard.beats() < 5], atol=0.5 / 30)  # to a frame


@pytest.mark.parametrize("dancers", [1, 2, 5, 7])
def test_groups_of_every_size_are_kept(data, dance, dancers):
    assert data.make(data.add("a", content(dance, dancers))).motion.num_dancers == dancers


def test_a_solo_may_lack_the_axis_of_dancers(data, dance):
    solo = {k: v[0] if isinstance(v, np.ndarray) else v for k, v in content(dance, 1).items()}
    assert data.make(data.add("a", solo)).motion.root.shape == (1, 150, 3)


def test_lists_of_all_splits_and_takes_in_none(data, dance):
    value = content(dance, 2)
    names = {split: data.add(f"in-{split}", value, split=split) for split in data.lists}
    lost = data.add("lost", value, split=None)
    jobs = {job.name: job for job in aioz_jobs(data.path)}
    assert len(jobs) == 4
    for split, name in names.items():
        assert jobs[f"aioz_{name}"].make().split == split
    with pytest.raises(ValueError, match=f"{lost}.*none of the lists"):
        jobs[f"aioz_{lost}"].make()


def test_the_one_list_of_the_readme_parts_videos(data, dance):
    value = content(dance, 1)
    names = [f"v{video}_{clip}_0_99" for video in range(30) for clip in range(2)]
    for name in names:
        data.add(name, value, split=None, music=False)
    data.add("lost", value, split=None, music=False)
    for path in data.path.glob("*.txt"):
        path.unlink()
    (data.path / "split_sequence_names.txt").write_text("\n".join(names))
    jobs = aioz_jobs(data.path)
    sides: dict = {}
    for job in jobs[:60]:
        sides.setdefault(job.make.keywords["group"], set()).add(job.make.keywords["split"])
    assert len(sides) == 30 and all(len(side) == 1 for side in sides.values())
    assert 1 <= [*sides.values()].count({"val"}) <= 6
    assert jobs[0].make().split in ("train", "val")
    with pytest.raises(ValueError, match=r"lost.*none of the lists"):
        jobs[60].make()


def test_clips_of_one_video_stay_together_within_a_split(data, dance):
    value, groups = content(dance, 2), {}
    for name, split in [("v_x_0_0_99", "train"), ("v_x_1_9_99", "train"), ("w_0_0_9", "train"),
                        ("w_1_0_9", "val")]:  # fmt: skip
        data.add(name, value, split=split, music=False)
        groups[name] = None
    groups = {name: data.make(name).group for name in groups}
    assert groups["v_x_0_0_99"] == groups["v_x_1_9_99"]
    assert len(set(groups.values())) == 3  # the official lists part w, so its group is parted too


@pytest.mark.parametrize("frames", [118, 150])
@pytest.mark.parametrize("seconds", [3.0, 4.9, 5.0])
def test_the_shorter_of_motion_and_music_counts(data, dance, frames, seconds):
    name = data.add("a", content(dance, 2, frames=frames), music=dance[2].slice(0, seconds))
    take = data.make(name)
    heard = 1 + int(seconds * 30)
    assert take.motion.num_frames == len(take.M) == min(frames, heard)
    assert take.notes["motion_frames"] == frames and take.notes["music_frames"] == heard
    assert take.beats.max() < take.motion.duration


def test_poses_and_path_of_different_length_are_cut(data, dance):
    value = content(dance, 2)
    value["root_trans"] = value["root_trans"][:, :97]
    assert data.make(data.add("a", value)).motion.num_frames == 97


def test_missing_and_silent_music(data, dance):
    take = data.make(data.add("a", content(dance, 2), music=False))
    assert (take.music, take.M, take.beats) == ("none", None, None)
    silent = Music(np.zeros((5 * 15360, 1), dtype=np.float32), 15360)
    take = data.make(data.add("b", content(dance, 2), music=silent))
    assert (take.music, take.M) == ("none", None) and take.notes["silent"]


@pytest.mark.parametrize("folder", ["musics438", "music"])
def test_music_in_the_folder_of_a_copy(data, dance, folder):
    name = data.add("a", content(dance, 2))
    (data.path / "musics").rename(data.path / folder)
    assert data.make(name).music == "original"


def test_hands_are_padded_and_orients_prepended(data, dance):
    whole = content(dance, 2)
    whole["smpl_poses"][..., 66:] = 0
    expected = data.make(data.add("whole", whole)).motion
    for name, part, orients in [("hands", slice(0, 66), False), ("orients", slice(3, 66), True),
                                ("root", slice(3, 72), True)]:  # fmt: skip
        value = {**whole, "smpl_poses": whole["smpl_poses"][..., part]}
        if orients:
            value["smpl_orients"] = whole["smpl_poses"][..., :3]
        motion = data.make(data.add(name, value)).motion
        assert motion.pose.equal(expected.pose), name
    assert expected.pose[:, :, 22:].equal(torch.eye(3).expand(2, 150, 2, 3, 3))


def test_pickles_of_python_2_and_float32(data, dance):
    value = content(dance, 2, dtype=np.float32)
    raw = pickle.dumps(value, 2).replace(b"numpy._core", b"numpy.core")
    assert data.make(data.add("a", raw)).motion.num_frames == 150


def test_labels(data, dance):
    name, other = data.add("a", content(dance, 2)), data.add("b", content(dance, 2))
    (data.path / "labels.csv").write_text(
        f"Name,Dance Style,Music Genre\n{name},Zumba,Latin\n{other},Kpop\n\n"
    )
    take = data.make(name)
    assert (take.genre, take.notes["style"]) == ("Latin", "Zumba")
    assert data.make(other).genre == "Kpop"


class Runs:
    def __reduce__(self):
        return Path.mkdir, (Path("was-here"),)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"smpl_poses": None}, "smpl_poses is NoneType"),
        ({"smpl_poses": np.zeros((2, 150, 70))}, "smpl_poses has 70"),
        ({"smpl_poses": np.zeros((2, 150, 63))}, "smpl_poses has 63"),
        ({"smpl_poses": np.zeros((2, 150, 63)), "smpl_orients": np.zeros((1, 2))}, "smpl_orients"),
        ({"smpl_poses": np.zeros((3, 150, 72))}, "3 dancers and paths of 2"),
        ({"smpl_poses": np.zeros((0, 150, 72))}, "shape"),
        ({"smpl_poses": np.array(["a"])}, "smpl_poses"),
        ({"root_trans": np.zeros((2, 150, 2))}, "root_trans has shape"),
        ({"root_trans": np.full((2, 150, 3), np.nan)}, "not finite"),
        ({"root_trans": np.full((2, 150, 3), 900.0)}, "unit"),
        ({"root_trans": np.zeros((2, 5, 3))}, "5 frames"),
        ({"meta": Runs()}, "mkdir"),
    ],
)
def test_what_is_wrong_is_told_with_the_file(data, dance, change, reason):
    name = data.add("a", {**content(dance, 2), **change}, music=False)
    with pytest.raises(ValueError, match=rf"{name}\.pkl.*{reason}"):
        data.make(name)
    assert not Path("was-here").exists()


def test_no_dict_a_missing_file_and_broken_music(data, dance):
    with pytest.raises(ValueError, match="list, not a dict"):
        data.make(data.add("a", [1]))
    name = data.add("b", content(dance, 2))
    (data.path / "musics" / f"{name}.wav").write_bytes(b"no sound")
    with pytest.raises(ValueError, match=r"\.wav"):
        data.make(name)
    (data.path / "motions_smpl" / f"{name}.pkl").unlink()
    with pytest.raises(ValueError, match=name):
        data.make(name)


def test_broken_folders_are_refused(tmp_path, data, dance):
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="motions_smpl"):
        aioz_jobs(tmp_path / "empty")
    name = data.add("a", content(dance, 2), music=False)
    data.lists["val"].append(name)
    data.write_lists()
    with pytest.raises(ValueError, match="train and of val"):
        aioz_jobs(data.path)
    data.lists = {"train": [name, "../../a"]}
    data.write_lists()
    (data.path / "val_split_sequence_names.txt").unlink()
    with pytest.raises(ValueError, match=r"line 2: '\.\./\.\./a'"):
        aioz_jobs(data.path)
    for path in data.path.glob("*.txt"):
        path.unlink()
    with pytest.raises(ValueError, match="no lists"):
        aioz_jobs(data.path)


def test_lists_may_have_more_columns_blank_lines_and_a_bom(data, dance):
    name = data.add("a", content(dance, 2), music=False)
    path = data.path / "train_split_sequence_names.txt"
    path.write_bytes(f"\ufeff{name}, 3, Latin\r\n\r\n".encode())
    assert data.make(name).split == "train"


def test_jobs_travel_to_other_processes(data, dance):
    data.add("a", content(dance, 2), music=False)
    (job,) = pickle.loads(pickle.dumps(aioz_jobs(data.path)))
    assert job.make().name == job.name


def test_the_script_shows_every_step_and_prepares_all(data, dance, capsys, tmp_path):
    name = data.add("a", content(dance, 2))
    data.add("b", content(dance, 7), split="val", music=False)
    data.add("broken", b"N", split="test")
    script("aioz").one_take(data.path)
    assert "(2, 150, 72)" in capsys.readouterr().out
    script("aioz").all_takes(data.path, tmp_path / "out", 1)
    assert "made 2" in capsys.readouterr().out
    prepared = PreparedData(tmp_path / "out")
    assert {entry.name: entry.dancers for entry in prepared} == {f"aioz_{name}": 2, BIG: 7}
    assert [row["name"] for row in prepared.skipped] == ["aioz_broken_0_0_150"]
    take, made = prepared.load(f"aioz_{name}"), data.make(name)
    assert take.M.equal(made.M) and (take.motion.root - made.motion.root).abs().max() < 1e-6


def script(name: str):
    path = DATA_PREP / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"prepare_{name}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_file_of_an_odd_name_is_reported_and_the_others_are_made(data, dance, tmp_path):
    data.add("a", content(dance, 2))
    data.add("v_01_0_100 (1)", content(dance, 2), split=None, music=False)
    summary = prepare(aioz_jobs(data.path), tmp_path / "out", progress=False)
    assert summary.made == 1 and "none of the lists" in " ".join(summary.skipped.values())
