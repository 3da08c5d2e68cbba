import importlib.util
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch

from dancediff.data.aistpp import GENRES, aistpp_jobs, music_tempo
from dancediff.data.choreographer import choreograph
from dancediff.data.prepared import PreparedData
from dancediff.data.resample import resample_motion
from dancediff.motion.rotation import matrix_to_axis_angle
from dancediff.music.song import Music
from dancediff.music.synth import synth_song
from places import DATA_PREP

NAME = "gBR_sBM_cAll_d04_mBR0_ch01"
SCALING, RAISED = 93.5, 0.7


@pytest.fixture(scope="module")
def dance():
    """A solo of six seconds at 60 frames a second, and the song."""
    song, truth = synth_song(7, seconds=6)
    motion, _ = choreograph(truth.beats, dancers=1, seed=4, seconds=6)
    return resample_motion(motion, 60), song


def content(dance, *, frames: int | None = None) -> dict:
    pose, root = dance[0].pose[0, :frames], dance[0].root[0, :frames]
    return {
        "smpl_loss": 1.5,
        "smpl_poses": matrix_to_axis_angle(pose).flatten(-2).numpy(),
        "smpl_scaling": np.array([SCALING], dtype=np.float32),
        "smpl_trans": ((root + torch.tensor([0.0, RAISED, 0.0])) * SCALING).numpy(),
    }


class Data:
    """A folder in the layout of AIST++."""

    def __init__(self, path: Path, song):
        self.path, self.song, self.lists = path, song, {"train": [], "val": [], "test": []}
        for folder in ("motions", "splits", "wavs"):
            (path / folder).mkdir()

    def add(self, name: str, value, *, split: str | None = "train", music=True):
        (self.path / "motions" / f"{name}.pkl").write_bytes(pickle.dumps(value))
        if music:
            self.song.save(self.path / "wavs" / f"{name}.wav")
        if split:
            self.lists[split].append(name)
        for side, names in self.lists.items():
            (self.path / "splits" / f"crossmodal_{side}.txt").write_text("\n".join(names))
        return name

    def make(self, name: str):
        return next(job for job in aistpp_jobs(self.path) if job.name == f"aistpp_{name}").make()


@pytest.fixture
def data(tmp_path, dance):
    return Data(tmp_path, dance[1])


def test_60_frames_a_second_become_every_other_one(data, dance):
    take = data.make(data.add(NAME, content(dance)))
    half = dance[0].pose[:, ::2]
    assert take.motion.fps == 30 and take.motion.num_frames == half.shape[1]
    assert (take.motion.pose - half).abs().max() < 1e-4
    gap = (take.motion.root - dance[0].root[:, ::2]).abs()
    assert gap[..., (0, 2)].max() < 1e-4 and gap[..., 1].max() < 0.02
    assert take.notes["floors"][0] == pytest.approx(RAISED, abs=0.02)
    assert (take.kind, take.music, take.genre) == ("real", "original", "Break")
    assert take.notes["tempo"] == 80 and take.notes["music_id"] == "mBR0"
    assert "CC BY 4.0" in take.licence
    heard = Music.load(data.path / "wavs" / f"{NAME}.wav").features()
    assert take.M.equal(heard[: take.motion.num_frames])


@pytest.mark.parametrize("frames", [300, 301])
def test_odd_and_even_lengths(data, dance, frames):
    take = data.make(data.add(NAME, content(dance, frames=frames)))
    assert take.motion.num_frames == len(take.M) == (frames + 1) // 2


def test_the_official_lists_and_the_ignore_list(data, dance):
    value = content(dance, frames=100)
    names = [f"gPO_sBM_cAll_d10_mPO{k}_ch0{k}" for k in range(5)]
    for name, split in zip(names, ("train", "train", "val", "test", None), strict=True):
        data.add(name, value, split=split, music=False)
    (data.path / "ignore_list.txt").write_text(f"{names[1]}\n")
    jobs = aistpp_jobs(data.path)
    assert [job.make().split for job in jobs] == ["train", "val", "test"]
    for path in (data.path / "splits").iterdir():  # as in copies without the folder
        path.rename(data.path / path.name)
    (data.path / "splits").rmdir()
    assert len(aistpp_jobs(data.path)) == 3


def test_takes_to_one_music_belong_together(data, dance):
    value = content(dance, frames=100)
    sides = {"d01_mHO0": "train", "d02_mHO0": "train", "d03_mHO5": "val", "d04_mHO5": "test"}
    takes = [
        data.make(data.add(f"gHO_sFM_cAll_{key}_ch01", value, split=split, music=False))
        for key, split in sides.items()
    ]
    assert takes[0].group == takes[1].group
    assert len({take.group for take in takes}) == 3  # the official lists part mHO5


def test_music_by_take_or_by_its_own_name_or_none(data, dance):
    name = data.add(NAME, content(dance, frames=200), music=False)
    take = data.make(name)
    assert (take.music, take.M, take.beats) == ("none", None, None)
    (data.path / "musics").mkdir()
    data.song.save(data.path / "musics" / "mBR0.flac")
    assert data.make(name).notes["song"] == "mBR0.flac"
    data.song.save(data.path / "wavs" / f"{name}.wav")
    assert data.make(name).notes["song"] == f"{name}.wav"
    (data.path / "wavs").rename(data.path / "wav")
    assert data.make(name).notes["song"] == f"{name}.wav"


@pytest.mark.parametrize(
    ("music", "tempo"), [("mBR0", 80), ("mJB3", 110), ("mHO0", 110), ("mHO5", 135), ("mKR5", 130)]
)
def test_tempo_from_the_name(music, tempo):
    assert music_tempo(music) == tempo
    assert len(GENRES) == 10


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"smpl_scaling": np.zeros(1)}, "smpl_scaling"),
        ({"smpl_scaling": np.ones(2)}, "smpl_scaling"),
        ({"smpl_scaling": None}, "smpl_scaling"),
        ({"smpl_scaling": "93"}, "smpl_scaling"),
        ({"smpl_scaling": np.array([0.5])}, "unit"),
        ({"smpl_poses": np.zeros((200, 69))}, "smpl_poses has shape"),
        ({"smpl_trans": np.zeros((1, 200, 3))}, "smpl_trans has shape"),
        ({"smpl_trans": np.full((200, 3), np.inf)}, "not finite"),
        ({"smpl_trans": np.zeros((20, 3))}, "10 frames"),
        ({"smpl_loss": np.array([{}])}, "O8"),
    ],
)
def test_what_is_wrong_is_told_with_the_file(data, dance, change, reason):
    value = {**content(dance, frames=200), **change}
    if change.get("smpl_scaling") is not None and "unit" in reason:
        value["smpl_trans"] = value["smpl_trans"] + 900
    data.add(NAME, value, music=False)
    with pytest.raises(ValueError, match=rf"{NAME}\.pkl.*{reason}"):
        data.make(NAME)


def test_broken_folders_are_refused(tmp_path, data):
    with pytest.raises(ValueError, match="motions"):
        aistpp_jobs(tmp_path / "splits")
    with pytest.raises(ValueError, match="no lists"):
        aistpp_jobs(tmp_path)
    for wrong in ("gBR_sBM", "gXX_sBM_cAll_d04_mBR0_ch01", "../x"):
        (tmp_path / "splits" / "crossmodal_train.txt").write_text(wrong)
        with pytest.raises(ValueError, match="no name of a take"):
            aistpp_jobs(tmp_path)


def test_jobs_travel_and_the_script_runs(data, dance, capsys, tmp_path):
    data.add(NAME, content(dance))
    (job,) = pickle.loads(pickle.dumps(aistpp_jobs(data.path)))
    assert job.make().name == job.name
    path = DATA_PREP / "aistpp.py"
    spec = importlib.util.spec_from_file_location("prepare_aistpp", path)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.one_take(data.path)
    assert "80 beats a minute" in capsys.readouterr().out
    script.all_takes(data.path, tmp_path / "out", 1)
    assert "made 1" in capsys.readouterr().out
    (entry,) = PreparedData(tmp_path / "out")
    assert (entry.name, entry.songs) == (f"aistpp_{NAME}", 1)
