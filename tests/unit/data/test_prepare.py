"""Preparing: the same bytes however often it is stopped, nothing skipped silently, flat memory."""

import importlib
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
import tracemalloc
import weakref
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from dancediff.data import prepare as module
from dancediff.data.prepare import prepare, recipe
from dancediff.data.prepared import PreparedData
from dancediff.data.take import DanceTake, Job
from dancediff.data.take_file import read_row, read_take, write_take
from dancediff.motion.motion import Motion


def tiny(name, seed, frames=40, n=1, split="train", kind="synthetic", group=None, wait=0.0):
    """A take of random paths; a module's function, as jobs must be."""
    time.sleep(wait)
    g = torch.Generator().manual_seed(seed)
    motion = Motion(
        torch.eye(3).expand(n, frames, 24, 3, 3), torch.randn(n, frames, 3, generator=g)
    )
    return DanceTake(
        name=name, dance=motion, kind=kind, music="synthetic", source="a test", licence="none",
        split=split, group=group or name, M=torch.randn(frames, 35, generator=g),
        beats=np.array([0.5, 1.0]), genre="waltz", notes={"seed": seed},
    )  # fmt: skip


alive: weakref.WeakSet = weakref.WeakSet()
most = [0]


def counted(name, seed):
    """`tiny`, and how many takes are in memory at once."""
    take = tiny(name, seed, frames=900)  # 0.6 MB
    alive.add(take.motion)
    most[0] = max(most[0], len(alive))
    return take


def bad(name):
    raise ValueError(f"{name} is\nno dance")


def jobs_of(count, **options):
    return [Job(f"t{k:03}", partial(tiny, f"t{k:03}", k, **options)) for k in range(count)]


def content(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_takes_are_written_and_listed(tmp_path):
    jobs = [*jobs_of(3), Job("c", partial(tiny, "c", 9, n=3, kind="composed", split="val"))]
    summary = prepare(jobs, tmp_path, progress=False)
    assert (summary.made, summary.kept, summary.skipped) == (4, 0, {})
    assert set(content(tmp_path)) == {
        "index.json", "takes/t000.npz", "takes/t001.npz", "takes/t002.npz", "composed/c.npz"
    }  # fmt: skip
    index = json.loads((tmp_path / "index.json").read_text())
    assert [row["name"] for row in index["takes"]] == ["c", "t000", "t001", "t002"]
    row = index["takes"][0]
    assert (row["kind"], row["split"], row["dancers"], row["frames"]) == ("composed", "val", 3, 40)
    assert (row["licence"], row["source"], row["genre"]) == ("none", "a test", "waltz")
    table = str(summary)
    assert "composed" in table and "made 4, kept 0, skipped 0" in table
    assert json.loads(json.dumps(summary.facts()))["made"] == 4


def test_a_take_survives_its_file(tmp_path):
    (tmp_path / "takes").mkdir()
    take = tiny("a", 3, n=2)
    path = write_take(tmp_path / "takes" / "a.npz", take, "recipe")
    again, row = read_take(path), read_row(path)
    assert torch.equal(again.motion.root, take.motion.root) and torch.equal(again.M, take.M)
    assert again.beats.tolist() == [0.5, 1.0] and again.notes == take.notes
    assert torch.equal(Motion.load(path).root, take.motion.root)  # it is a Motion file too
    assert (row["made_by"], row["songs"], row["dancers"]) == ("recipe", 1, 2)
    path.write_bytes(path.read_bytes()[:-50])
    for read in (read_take, read_row):
        with pytest.raises(ValueError, match="no prepared take"):
            read(path)


def test_bytes_do_not_depend_on_time_or_workers(tmp_path):
    prepare(jobs_of(5), tmp_path / "a", progress=False)
    time.sleep(2.1)  # zip files count time in steps of two seconds
    prepare(jobs_of(5)[::-1], tmp_path / "b", workers=2, progress=False)
    assert content(tmp_path / "a") == content(tmp_path / "b")


def test_a_bad_take_is_reported_and_the_others_are_made(tmp_path):
    def other():  # not even a ValueError
        raise KeyError("smpl_poses")

    jobs = [Job("bad", partial(bad, "bad")), *jobs_of(2), Job("odd", other)]
    jobs.append(Job("liar", partial(tiny, "truth", 1)))
    summary = prepare(jobs, tmp_path, progress=False)
    assert summary.made == 2 and summary.prepared == 2
    assert summary.skipped["bad"] == "bad is no dance"
    assert summary.skipped["odd"] == "KeyError: 'smpl_poses'"
    assert "'truth'" in summary.skipped["liar"]
    assert "    bad: bad is no dance" in str(summary) and "skipped 3" in str(summary)
    data = PreparedData(tmp_path)
    assert [row["name"] for row in data.skipped] == ["bad", "liar", "odd"] and len(data) == 2


def test_nothing_good_is_a_summary_too(tmp_path):
    summary = prepare([Job("bad", partial(bad, "bad"))], tmp_path, progress=False)
    assert summary.prepared == 0 and len(PreparedData(tmp_path)) == 0


def test_a_stopped_run_goes_on(tmp_path, monkeypatch):
    prepare(jobs_of(6), tmp_path / "whole", progress=False)
    write, left = write_take, [3]

    def then_stop(*args):
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        return write(*args)

    monkeypatch.setattr(module, "write_take", then_stop)
    with pytest.raises(KeyboardInterrupt):
        prepare(jobs_of(6), tmp_path / "parts", progress=False)
    monkeypatch.setattr(module, "write_take", write)
    assert len(list((tmp_path / "parts").rglob("*.npz"))) == 3
    left_over = tmp_path / "parts" / ".part-xyz"
    left_over.mkdir()
    (left_over / "t004.npz").write_bytes(b"half a file")
    summary = prepare(jobs_of(6), tmp_path / "parts", progress=False)
    assert (summary.made, summary.kept) == (3, 3)
    assert content(tmp_path / "whole") == content(tmp_path / "parts")


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="SIGKILL is of Unix")
def test_a_killed_process_goes_on(tmp_path):
    """As a user does it: kill -9 in the middle, then the same command again."""
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from test_prepare import jobs_of, prepare\n"
        "prepare(jobs_of(8, wait=0.15), sys.argv[1], progress=False)"
    )
    # jobs of another process are of the module test_prepare, so both folders are made by one
    command = [sys.executable, "-c", code]
    running = subprocess.Popen([*command, tmp_path / "parts"])
    for _ in range(600):
        time.sleep(0.05)
        if len(list((tmp_path / "parts").rglob("*.npz"))) >= 2:
            break
    running.send_signal(signal.SIGKILL)
    running.wait()
    assert not (tmp_path / "parts" / "index.json").exists()
    for folder in ("parts", "whole"):
        subprocess.run([*command, tmp_path / folder], check=True)
    assert content(tmp_path / "whole") == content(tmp_path / "parts")


def test_a_changed_recipe_is_made_anew_and_other_takes_stay(tmp_path):
    prepare(jobs_of(3), tmp_path, progress=False)
    before = content(tmp_path)
    changed = [Job("t001", partial(tiny, "t001", 77))]
    summary = prepare(changed, tmp_path, progress=False)
    assert (summary.made, summary.kept) == (1, 0)
    after = content(tmp_path)
    assert [name for name in before if before[name] != after[name]] == [
        "index.json", "takes/t001.npz"
    ]  # fmt: skip
    assert [entry.name for entry in PreparedData(tmp_path)] == ["t000", "t001", "t002"]
    # a take that has become bad is no longer there, so no old version passes for it
    summary = prepare([Job("t001", partial(bad, "t001"))], tmp_path, progress=False)
    assert list(summary.skipped) == ["t001"]
    assert [entry.name for entry in PreparedData(tmp_path)] == ["t000", "t002"]
    assert not (tmp_path / "takes" / "t001.npz").exists()


def test_takes_that_are_replaced_leave_once_the_index_is_written(tmp_path, monkeypatch):
    out, outside = tmp_path / "out", tmp_path / "mine.npz"
    prepare(jobs_of(3), out, progress=False)
    outside.touch()
    index = json.loads((out / "index.json").read_text())
    index["takes"].append({"name": "../../mine"})  # as nobody but an attacker writes it
    (out / "index.json").write_text(json.dumps(index))
    before = content(out)

    def full(path):
        raise OSError("no space left on device")

    again = partial(prepare, jobs_of(1), out, replaces=lambda row: True, progress=False)
    with monkeypatch.context() as patch:
        patch.setattr(module, "atomic_write", full)
        with pytest.raises(OSError, match="no space"):
            again()
    assert content(out) == before
    summary = again()
    assert (summary.kept, summary.dropped) == (1, ["t001", "t002"])
    assert "dropped 2 takes, which" in str(summary)
    assert summary.facts()["dropped"] == ["t001", "t002"]
    assert set(content(out)) == {"index.json", "takes/t000.npz"} and outside.exists()
    assert again().dropped == []


def test_recipe_follows_arguments_not_places(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "dance.bvh").write_text("same")

    def of(*args, **options):
        return recipe(Job("x", partial(tiny, *args, **options)))

    assert of(tmp_path / "a" / "dance.bvh") == of(tmp_path / "b" / "dance.bvh")
    assert of("x", 1) != of("x", 2) and of("x", n=1) != of("x", n=2)
    assert recipe(Job("x", partial(partial(tiny, "x"), 1))) != of("x", 2)
    (tmp_path / "b" / "dance.bvh").write_text("asme")  # of the same size
    assert of(tmp_path / "a" / "dance.bvh") != of(tmp_path / "b" / "dance.bvh")


def test_a_changed_reader_of_ones_own_is_another_recipe(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    found = set()
    for text in ("def read(name): return 1\n", "def read(name): return 2\n"):
        (tmp_path / "reader_of_mine.py").write_text(text)
        monkeypatch.delitem(sys.modules, "reader_of_mine", raising=False)
        read = importlib.import_module("reader_of_mine").read
        found.add(recipe(Job("x", partial(read, "x"))))
    assert len(found) == 2


def test_damaged_take_is_made_anew(tmp_path):
    prepare(jobs_of(2), tmp_path, progress=False)
    before = content(tmp_path)
    (tmp_path / "takes" / "t000.npz").write_bytes(b"PK nonsense")
    (tmp_path / "index.json").write_text("{")
    assert prepare(jobs_of(2), tmp_path, progress=False).made == 1
    assert content(tmp_path) == before


def test_full_disk_ends_the_run_and_leaves_no_half_file(tmp_path, monkeypatch):
    def full(self, path, song=None):
        Path(path).write_bytes(b"half")
        raise OSError("no space left on device")

    monkeypatch.setattr(Motion, "save", full)
    with pytest.raises(OSError, match="no space"):
        prepare(jobs_of(2), tmp_path, progress=False)
    assert content(tmp_path) == {}


def memory_peak(folder, count):
    """The most bytes that preparing ``count`` takes holds, and the most takes alive at once."""
    prepare(jobs_of(2), folder / f"warm{count}", progress=False)
    jobs = [Job(f"t{k:03}", partial(counted, f"t{k:03}", k)) for k in range(count)]
    tracemalloc.start()
    prepare(jobs, folder / str(count), progress=False)
    return tracemalloc.get_traced_memory()[1], most[0]


@pytest.mark.slow
def test_memory_does_not_grow_with_the_number_of_takes(tmp_path):
    # each in a process of its own: what other tests left running in this one allocates memory, too
    pool = partial(ProcessPoolExecutor, 1, mp_context=multiprocessing.get_context("spawn"))
    with pool() as one, pool() as other:
        short, long = (
            one.submit(memory_peak, tmp_path, 20),
            other.submit(memory_peak, tmp_path, 200),
        )
        (few, _), (many, together) = short.result(), long.result()
    assert few > 500_000  # takes are seen at all
    assert many < few + 300_000, (few, many)  # 200 takes are 110 MB
    assert 1 <= together <= 2  # the one being made, and the one before


@pytest.mark.parametrize(
    ("jobs", "options", "words"),
    [
        ([], {}, "list of jobs is empty"),
        ([Job("a", bad), Job("a", bad)], {}, "2 takes are called 'a'"),
        ([Job("../a", bad)], {}, r"'\.\./a'"),
        ([Job("a", bad)], {"workers": 0}, "workers=0"),
        ([Job("a", bad)], {"backend": "spark"}, "backend='spark'.*loky, dask, ray"),
    ],
)
def test_bad_arguments_are_named(tmp_path, jobs, options, words):
    with pytest.raises(ValueError, match=words):
        prepare(jobs, tmp_path / "out", progress=False, **options)
    assert not (tmp_path / "out").exists()


def from_file(name, path):
    path.read_bytes()
    return tiny(name, 1)


def test_a_source_that_is_gone_for_now_costs_no_take(tmp_path):
    source, out = tmp_path / "a.txt", tmp_path / "out"
    source.write_text("a")
    jobs = [Job("a", partial(from_file, "a", source))]
    prepare(jobs, out, progress=False)
    source.rename(tmp_path / "away.txt")
    summary = prepare(jobs, out, progress=False)
    assert list(summary.skipped) == ["a"] and len(PreparedData(out)) == 0
    (tmp_path / "away.txt").rename(source)
    assert prepare(jobs, out, progress=False).kept == 1


def test_a_file_that_cannot_be_read_does_not_end_the_run(tmp_path, monkeypatch):
    for name in "ab":
        (tmp_path / name).write_text(name)
    jobs = [Job(name, partial(from_file, name, tmp_path / name)) for name in "ab"]

    def refuse(path):
        if path.name == "a":
            raise PermissionError(13, "Permission denied", str(path))
        return "digest"

    monkeypatch.setattr("dancediff.data.prepare._content", refuse)
    summary = prepare(jobs, tmp_path / "out", progress=False)
    assert summary.made == 1 and "Permission denied" in summary.skipped["a"]


def test_a_damaged_take_of_an_earlier_run_is_reported(tmp_path):
    prepare(jobs_of(2), tmp_path, progress=False)
    path = tmp_path / "takes" / "t000.npz"
    path.write_bytes(path.read_bytes()[:100])
    summary = prepare(jobs_of(2)[1:], tmp_path, progress=False)
    assert "prepare it anew" in summary.skipped["t000"]
    assert [entry.name for entry in PreparedData(tmp_path)] == ["t001"]
    assert prepare(jobs_of(2), tmp_path, progress=False).made == 1
