"""Takes in memory maps: the same numbers, packed once, small to send."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch
from test_prepare import jobs_of, tiny

from dancediff.data.augment import Augmentation
from dancediff.data.packed import PackedTakes
from dancediff.data.prepare import prepare
from dancediff.data.prepared import PreparedData
from dancediff.data.take import Job
from dancediff.data.windows import GroupCut, WindowSampler


class Made:
    """A job that hands out a take."""

    def __init__(self, take, **changes):
        from dataclasses import replace

        self.take = replace(take, **changes)

    def __call__(self):
        return self.take


@pytest.fixture
def folder(tmp_path):
    two = tiny("two", 3, n=2, frames=170)
    jobs = [
        *jobs_of(2, frames=160),
        Job("two", Made(two, M_other=torch.randn(2, 170, 35))),
        Job("mute", Made(tiny("mute", 4), M=None, beats=None, music="none")),
        Job("v", Made(tiny("v", 5, split="val"))),
    ]
    prepare(jobs, tmp_path, progress=False)
    return tmp_path


def test_what_comes_out_is_what_went_in(folder):
    data, packed = PreparedData(folder), PackedTakes(folder)
    assert len(packed) == 3
    for k, name in enumerate(["t000", "t001", "two"]):
        take = data.load(name)
        assert torch.equal(packed.motion(k), take.motion.features())
        assert torch.equal(packed.music(k)[0], take.M)
        assert torch.equal(packed.motion(k, 7, 19), take.motion.features()[:, 7:19])
    assert torch.equal(packed.music(2)[1:], data.load("two").M_other)
    assert packed.music(2, 5, 9).shape == (3, 4, 35)


def test_packed_once_and_again_when_the_takes_change(folder):
    first = PackedTakes(folder)
    stamp = (first.folder / "x.npy").stat().st_mtime_ns
    again = PackedTakes(folder)
    assert again.folder == first.folder and (again.folder / "x.npy").stat().st_mtime_ns == stamp
    assert not list((folder / "cache").glob(".packing*"))
    prepare([Job("more", Made(tiny("more", 8)))], folder, progress=False)
    more = PackedTakes(folder)
    assert more.folder != first.folder and len(more) == 4


@pytest.mark.parametrize("rest", [0, 40, 200])
def test_a_damaged_cache_names_its_file(folder, rest):
    packed = PackedTakes(folder)
    path = packed.folder / "x.npy"
    path.write_bytes(path.read_bytes()[:rest])
    with pytest.raises(ValueError, match=r"x\.npy' is damaged .*; delete the folder it is in"):
        PackedTakes(folder).motion(0)


def test_a_kill_while_packing_leaves_no_half_cache(folder, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(PackedTakes, "_put", stop)
    with pytest.raises(KeyboardInterrupt):
        PackedTakes(folder)
    monkeypatch.undo()
    assert torch.equal(
        PackedTakes(folder).motion(0), PreparedData(folder).load("t000").motion.features()
    )


def test_another_process_that_packs_meanwhile_may_be_faster(folder, monkeypatch):
    replace, others = Path.replace, []

    def overtaken(self, target):
        if not others:
            others.append(None)
            others[0] = PackedTakes(folder)
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", overtaken)
    mine = PackedTakes(folder)
    assert torch.equal(mine.motion(1), others[0].motion(1))
    assert not list(mine.folder.parent.glob(".packing-*"))


def test_sent_to_another_process_it_is_small(folder):
    packed = PackedTakes(folder)
    before = packed.motion(2).clone()
    sent = pickle.dumps(packed)
    assert len(sent) < 10_000 and torch.equal(pickle.loads(sent).motion(2), before)


def test_changing_what_was_read_changes_no_file(folder):
    PackedTakes(folder).motion(0).add_(1)
    assert torch.equal(
        PackedTakes(folder).motion(0), PreparedData(folder).load("t000").motion.features()
    )


def test_an_index_that_lies_is_noticed(folder):
    path = folder / "index.json"
    path.write_text(path.read_text().replace('"frames": 160', '"frames": 150'))
    with pytest.raises(ValueError, match="'t000' is not as its index says"):
        PackedTakes(folder)


def test_empty_split(folder):
    packed = PackedTakes(folder, "test")
    assert len(packed) == 0 and packed.takes() == []


def test_takes_for_training(folder):
    packed = PackedTakes(folder)
    takes = packed.takes(num_frames=165)
    assert [t.name for t in takes] == ["two"] and takes[0].M_other.shape == (2, 170, 35)
    assert [t.name for t in packed.takes(max_dancers=1)] == ["t000", "t001"]
    options = {"augment": Augmentation(music=True), "dancers_per_batch": 8}
    windows = WindowSampler(packed.takes(), GroupCut(), **options)
    songs = [packed.music(2)[k] for k in range(3)]
    heard = set()
    for step in range(12):
        x, M, *_ = windows.batch(step)
        if x.shape[1] == 2:
            for window in M:
                heard |= {
                    k for k, song in enumerate(songs)
                    if any(torch.equal(song[s : s + 150], window) for s in range(21))
                }  # fmt: skip
    assert heard == {0, 1, 2}
    plain = WindowSampler(packed.takes(), GroupCut(), dancers_per_batch=8)
    assert all(np.isfinite(part.numpy()).all() for part in plain.batch(0)[:2])


def test_no_file_is_made_as_large_as_a_wrong_index_says(folder):
    path = folder / "index.json"
    index = json.loads(path.read_text())
    next(row for row in index["takes"] if row["name"] == "two")["frames"] = 10**8
    path.write_text(json.dumps(index))
    with pytest.raises(ValueError, match="take 'two' is not as its index says"):
        PackedTakes(folder)
    assert not (folder / "cache").exists()


def test_others_may_read_a_cache_and_are_told_when_not(folder, monkeypatch):
    (folder / "cache").mkdir(exist_ok=True)
    (folder / "cache").chmod(0o755)
    packed = PackedTakes(folder)
    assert packed.folder.stat().st_mode & 0o777 == 0o755

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(np, "load", refuse)
    with pytest.raises(PermissionError, match=r"ask its owner.*x\.npy"):
        packed.motion(0)


def test_preparing_removes_what_a_killed_packing_left(folder):
    left = folder / "cache" / ".packing-abc"
    left.mkdir(parents=True)
    (left / "x.npy").touch()
    prepare(jobs_of(1), folder, progress=False)
    assert not left.exists()
