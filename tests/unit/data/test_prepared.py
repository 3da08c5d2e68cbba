"""Reading a prepared folder: what is wrong with it is said, and nothing leaks across splits."""

import json

import pytest
import torch
from test_prepare import jobs_of, tiny

from dancediff.data.prepare import prepare
from dancediff.data.prepared import PreparedData
from dancediff.data.take import DanceTake, Job


@pytest.fixture
def folder(tmp_path):
    jobs = jobs_of(3)
    jobs += [
        job("v", 5, n=2, split="val", group="a song"),
        job("w", 6, split="val", group="a song"),
    ]
    prepare(jobs, tmp_path, progress=False)
    return tmp_path


def job(name, seed, **options):
    from functools import partial

    return Job(name, partial(tiny, name, seed, **options))


def change(folder, **values):
    index = json.loads((folder / "index.json").read_text())
    index["takes"][-1] |= values
    (folder / "index.json").write_text(json.dumps(index))


def test_entries_splits_and_takes(folder):
    data = PreparedData(folder)
    assert len(data) == 5 and [e.name for e in data.split("val")] == ["v", "w"]
    assert data.split("test") == []
    take = data.load("v")
    assert isinstance(take, DanceTake) and take.motion.num_dancers == 2
    assert torch.equal(take.motion.root, tiny("v", 5, n=2).motion.root)
    assert [data.load(entry).name for entry in data.split("val")] == ["v", "w"]


def test_reading_the_index_reads_no_dance(folder):
    for path in folder.rglob("*.npz"):
        path.write_bytes(b"")
    data = PreparedData(folder)
    with pytest.raises(ValueError, match=r"t000\.npz.*prepare it anew"):
        data.load("t000")
    (folder / "takes" / "t000.npz").unlink()
    with pytest.raises(ValueError, match=r"t000\.npz.*is missing"):
        data.load("t000")
    with pytest.raises(ValueError, match="no take 'nobody'"):
        data.load("nobody")
    with pytest.raises(ValueError, match="split='all'"):
        data.split("all")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"kind": "faked"}, "'w'.*kind='faked'.*real, composed, synthetic"),
        ({"music": 3}, "music=3"),
        ({"split": "dev"}, "split='dev'"),
        ({"frames": -4}, "frames=-4"),
        ({"dancers": True}, "dancers=True"),
        ({"file": "../../etc/w.npz"}, "not where takes are"),
        ({"name": "../w"}, "no name of a take"),
        ({"name": None}, "'None'"),
        ({"fps": 60}, "fps=60"),
        ({"group": ""}, "no group"),
        ({"name": "v", "file": "takes/v.npz"}, "two takes have one name"),
        ({"split": "train"}, "'v' is in val and 'w' in train, but both belong to 'a song'"),
        ({"split": "train", "group": "x + a song"}, "both belong to 'a song'; give them one split"),
    ],
)
def test_a_wrong_index_is_named(folder, values, words):
    change(folder, **values)
    with pytest.raises(ValueError, match=words):
        PreparedData(folder)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "JSON"),
        ("[]", "format"),
        ('{"format": "dancediff-prepared-9"}', "dancediff-prepared-1"),
        ('{"format": "dancediff-prepared-1", "takes": 3}', "list of takes"),
        ('{"format": "dancediff-prepared-1", "takes": [3]}', "take '3'"),
        ('{"format": "dancediff-prepared-1", "takes": [{"name": "a"}]}', "take 'a'"),
    ],
)
def test_no_index_at_all(tmp_path, text, words):
    (tmp_path / "index.json").write_text(text)
    with pytest.raises(ValueError, match=words):
        PreparedData(tmp_path)


def test_a_folder_that_is_none():
    with pytest.raises(ValueError, match=r"dancediff prepare"):
        PreparedData("nowhere")
