import importlib.util
import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.data.finedance import ALL, IGNORED, LEGS, SKIP, finedance_jobs, split_of
from dancediff.data.prepare import prepare
from dancediff.data.prepared import PreparedData
from dancediff.genre import FINEDANCE
from dancediff.motion.contact import TOE_CLEARANCE
from dancediff.motion.rotation import matrix_to_rot6d
from dancediff.motion.skeleton import FOOT_JOINTS
from dancediff.music.song import Music
from dancediff.music.synth import synth_song
from places import DATA_PREP

RAISED = 0.4  # metres between the floor of the files and ours


@pytest.fixture(scope="module")
def dance():
    """A solo of six seconds, and the song."""
    song, truth = synth_song(5, seconds=6)
    motion, _ = choreograph(truth.beats, dancers=1, seed=2, seconds=6)
    return motion, song


def content(motion, *, frames: int = 180) -> np.ndarray:
    """What a motion file holds: path, 22 joints of the body, 30 of the fingers."""
    root = (motion.root[0, :frames] + torch.tensor([0.0, RAISED, 0.0])) / LEGS
    body = matrix_to_rot6d(motion.pose[0, :frames, :22]).flatten(1)
    fingers = torch.randn(len(root), 30 * 6)
    return torch.cat([root, body, fingers], 1).numpy()


class Data:
    """A folder in the layout of FineDance."""

    def __init__(self, path: Path, song):
        self.path, self.song = path, song
        for folder in ("motion", "music_wav", "label_json"):
            (path / folder).mkdir()

    def add(self, name: str, array, *, music=True, style: str | None = None):
        np.save(self.path / "motion" / f"{name}.npy", array)
        if music:
            song = self.song if music is True else music
            song.save(self.path / "music_wav" / f"{name}.wav")
        if style is not None:
            label = {"name": "A Song", "style1": "Modern", "style2": style}
            (self.path / "label_json" / f"{name}.json").write_text(json.dumps(label))
        return name

    def make(self, name: str):
        jobs = {job.name: job for job in finedance_jobs(self.path)}
        return jobs[f"finedance_{name}"].make()


@pytest.fixture
def data(tmp_path, dance):
    return Data(tmp_path, dance[1])


def test_a_dance_comes_back(data, dance):
    take = data.make(data.add("001", content(dance[0]), style="Hiphop"))
    gap = (take.motion.root[0] - dance[0].root[0, :180]).abs()
    assert gap[:, (0, 2)].max() < 1e-4
    assert gap[:, 1].max() < 0.03
    assert (take.motion.pose[:, :, :22] - dance[0].pose[:, :180, :22]).abs().max() < 1e-4
    assert take.motion.pose[:, :, 22:].equal(torch.eye(3).expand(1, 180, 2, 3, 3))  # hands rest
    assert (take.kind, take.music, take.split, take.genre) == (
        "real",
        "original",
        "train",
        "Hiphop",
    )
    assert "non-commercial" in take.licence
    assert take.M.equal(Music.load(data.path / "music_wav" / "001.wav").features()[:180])


def test_columns_of_rotations_would_be_the_inverse(data, dance):
    """The six numbers are rows; read as columns, the joints would be far away."""
    take = data.make(data.add("001", content(dance[0])))
    joints = take.motion.joints() - take.motion.root[:, :, None]
    truth = dance[0].frames(0, 180)
    gap = joints - (truth.joints() - truth.root[:, :, None])
    assert gap[:, :, :22].abs().max() < 1e-3


def test_splits_of_the_papers():
    sides = {name: split_of(name) for name in sorted(ALL - IGNORED)}
    assert len(ALL) == 211 and len(IGNORED) == 9 and len(sides) == 202
    assert sum(side == "test" for side in sides.values()) == 19  # 20, of which 120 is ignored
    assert sides["063"] == sides["204"] == "test" and sides["001"] == "train"
    dancer = [split_of(name, "dancer") for name in sides]
    assert (dancer.count("test"), dancer.count("val")) == (13 + 5, 12 - 4)


def test_ignored_and_mirrored_dances_are_left_out(data, dance):
    for name in ("001", "M001", "116", "120", "123", "202", "063"):
        data.add(name, content(dance[0]), music=False)
    jobs = finedance_jobs(data.path)
    assert [job.name for job in jobs] == ["finedance_001", "finedance_063"]
    assert [job.make().split for job in jobs] == ["train", "test"]
    assert finedance_jobs(data.path, split="dancer")[0].make().split == "test"
    with pytest.raises(ValueError, match="split='song'"):
        finedance_jobs(data.path, split="song")


def test_a_name_without_a_split_is_reported(data, dance):
    data.add("212", content(dance[0]), music=False)
    with pytest.raises(ValueError, match=r"212\.npy.*001 to 211"):
        data.make("212")


@pytest.mark.parametrize("name", ["010", "067"])
def test_the_start_is_cut_of_motion_and_music(data, dance, name):
    x = content(dance[0])
    skip = SKIP[name]
    long = np.concatenate([np.repeat(x[:1], skip, 0), x])
    take = data.make(data.add(name, long, music=synth_song(5, seconds=14)[0]))
    assert take.motion.num_frames == 180 and take.notes["skipped"] == skip
    whole = data.make(data.add("001", x, music=False)).motion
    assert (take.motion.root - whole.root).abs().max() < 1e-5
    heard = Music.load(data.path / "music_wav" / f"{name}.wav").features()
    assert take.M.equal(heard[skip : skip + 180])


def test_all_cuts_are_those_of_lodge():
    assert {name: frames / 30 for name, frames in SKIP.items() if frames > 3} == {
        "004": 8, "005": 10, "067": 6, "105": 19, "110": 14, "113": 29, "153": 52, "211": 22,
    }  # fmt: skip


@pytest.mark.parametrize("more", [-2, -1, 0, 1, 2])
def test_lengths_that_differ_by_two_frames(data, dance, more):
    x, heard = content(dance[0]), dance[1].num_frames
    frames = heard + more
    take = data.make(data.add("001", np.concatenate([x, x])[:frames]))
    assert take.motion.num_frames == len(take.M) == min(frames, heard)
    assert ("music_frames" in take.notes) == (more != 0)


def test_the_floor_follows_the_first_frame(data, dance):
    x = content(dance[0])
    for other in (0.0, 0.01, 0.3):  # the right foot is lifted by bending the knee
        y = x.copy()
        if other:
            bent = torch.tensor([1.0, 0, 0, 0, np.cos(4 * other), -np.sin(4 * other)])
            y[0, 3 + 5 * 6 : 3 + 6 * 6] = bent.numpy()
        take = data.make(data.add("001", y, music=False))
        left, right = take.motion.joints()[0, 0, FOOT_JOINTS[2:], 1].tolist()
        height = (left + right) / 2 if abs(left - right) < 0.02 else min(left, right)
        assert height == pytest.approx(TOE_CLEARANCE, abs=1e-4)


@pytest.mark.parametrize(
    ("style", "genre"),
    [("jazz", "Jazz"), ("Tai", "Dai"), ("Wei", "Wei"), ("Uighur", "Wei"), ("Hmong", "Miao"),
     (" ShenYun ", "ShenYun"), ("Tango", None), ("", None)],
)  # fmt: skip
def test_genres_have_one_name(data, dance, style, genre):
    take = data.make(data.add("001", content(dance[0]), music=False, style=style))
    assert (take.genre, take.notes["style2"]) == (genre, style)
    assert len(FINEDANCE) == len(set(FINEDANCE)) == 16


def test_missing_music_and_labels(data, dance):
    take = data.make(data.add("001", content(dance[0]), music=False))
    assert (take.music, take.M, take.genre) == ("none", None, None)


def test_files_with_contacts_before_the_path(data, dance):
    x = content(dance[0])
    wide = np.concatenate([np.ones((180, 4), dtype=np.float32), x], 1)
    a, b = (data.make(data.add(n, v, music=False)).motion for n, v in [("001", x), ("002", wide)])
    assert a.pose.equal(b.pose)


@pytest.mark.parametrize(
    ("array", "reason"),
    [
        (np.zeros((180, 315)), "length 0"),
        (np.ones((180, 139)), "180, 139"),
        (np.ones((0, 315)), "array|shape"),
        (np.ones(315), "315"),
        (np.full((180, 315), np.nan), "not finite"),
        (np.ones((180, 315), dtype=complex), "numbers"),
        (np.ones((5, 315)), "5 frames"),
        (np.array([{}], dtype=object), "object|Python"),
    ],
)
def test_what_is_wrong_is_told_with_the_file(data, array, reason):
    data.add("001", array, music=False)
    with pytest.raises(ValueError, match=rf"001\.npy.*({reason})"):
        data.make("001")


def test_broken_files(data, dance, tmp_path):
    name = data.add("001", content(dance[0]), music=False, style="Jazz")
    path = tmp_path / "motion" / "001.npy"
    whole = path.read_bytes()
    label = tmp_path / "label_json" / "001.json"
    for broken in ("[1]", "{", '{"style2": 3}', "[" * 100_000):
        label.write_text(broken)
        with pytest.raises(ValueError, match=r"001\.json"):
            data.make(name)
    label.unlink()
    promise = whole.replace(b"(180, 315), }" + 9 * b" ", b"(99999999999, 315), } ")
    for broken in (b"", b"hello", whole[:100], whole[:-7], promise):
        path.write_bytes(broken)
        with pytest.raises(ValueError, match=r"001\.npy"):
            data.make(name)
    assert promise != whole
    data.add("153", content(dance[0]), music=False)
    with pytest.raises(ValueError, match="first 1560"):
        data.make("153")


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(ValueError, match="motion"):
        finedance_jobs(tmp_path)


def test_jobs_travel_and_the_script_runs(data, dance, capsys, tmp_path):
    data.add("001", content(dance[0]), style="Jazz")
    (job,) = pickle.loads(pickle.dumps(finedance_jobs(data.path)))
    assert job.make().name == job.name
    path = DATA_PREP / "finedance.py"
    spec = importlib.util.spec_from_file_location("prepare_finedance", path)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.one_take(data.path)
    assert "genre: Jazz" in capsys.readouterr().out
    script.all_takes(data.path, tmp_path / "out", 1, "genre")
    assert "made 1" in capsys.readouterr().out
    (entry,) = PreparedData(tmp_path / "out")
    assert (entry.name, entry.songs) == ("finedance_001", 1)


def test_a_file_of_an_odd_name_is_reported_and_the_others_are_made(dance, tmp_path):
    data = Data(tmp_path, dance[1])
    for name in ("001", "001 (1)"):
        data.add(name, content(dance[0]))
    summary = prepare(finedance_jobs(tmp_path), tmp_path / "out", progress=False)
    assert summary.made == 1 and "none of 001 to 211" in " ".join(summary.skipped.values())


def test_a_label_with_a_mark_is_read(data, dance):
    name = data.add("001", content(dance[0]), music=False, style="Jazz")
    label = data.path / "label_json" / "001.json"
    label.write_text(label.read_text(), encoding="utf-8-sig")
    assert data.make(name).genre == "Jazz"
