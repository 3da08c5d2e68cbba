"""`dancediff generate` for many songs: nothing twice, nothing lost, one bad song stops nobody."""

import json
import sys

import numpy as np
import pytest

from dancediff import hub
from dancediff.arrays import read_arrays
from dancediff.cli import main, many_songs
from dancediff.metrics.dances import read_dance
from dancediff.music.song import Music
from tiny_tcdiffpp import tiny_tcdiffpp

SHORT = ["--seconds", "2", "--steps", "2", "--formats", "npz", "--json"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Three songs, a model of random weights, and the folder is where commands run."""
    rng = np.random.default_rng(0)
    for name in ("a", "b", "c"):
        sound = 0.1 * rng.normal(size=22050 * 3).astype(np.float32)
        (tmp_path / "songs").mkdir(exist_ok=True)
        Music(sound, 22050, name).save(tmp_path / "songs" / f"{name}.wav")
    hub.save_model(tiny_tcdiffpp().model, tmp_path / "tiny")
    monkeypatch.chdir(tmp_path)
    many_songs.loaded.cache_clear()
    many_songs.model_digest.cache_clear()
    return tmp_path


def dance(capsys, *words, status=0):
    """What the command says, as JSON."""
    model = [] if "--model" in words else ["--model", "tiny"]
    assert main(["generate", *words, *model, *SHORT]) == status
    return json.loads(capsys.readouterr().out)


def content(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*.*")}


def test_each_song_has_a_folder_and_is_danced_to_once(folder, capsys):
    said = dance(capsys, "songs")
    assert (said["made"], said["kept"], said["failed"]) == (3, 0, {})
    files = ["dance.json", "dance.npz"]
    assert sorted(content(folder / "out")) == [f"{s}/{f}" for s in "abc" for f in files]
    before = {p: p.stat().st_mtime_ns for p in (folder / "out").rglob("*")}
    said = dance(capsys, "songs")
    assert (said["made"], said["kept"]) == (0, 3) and said["dances"]["a"]["frames"] == 60
    assert before == {p: p.stat().st_mtime_ns for p in (folder / "out").rglob("*")}


def test_bytes_depend_neither_on_the_order_nor_on_what_else_is_made(folder, capsys):
    dance(capsys, "songs", "--out", "all")
    songs = [f"songs/{name}.wav" for name in "cab"]
    dance(capsys, *songs, "--out", "list")
    dance(capsys, songs[1], "--workers", "1", "--out", "alone")
    assert content(folder / "all") == content(folder / "list")
    alone = content(folder / "alone")
    assert set(alone) == {"a/dance.json", "a/dance.npz"}
    assert alone.items() <= content(folder / "all").items()


@pytest.mark.parametrize("change", ["option", "song", "model", "file", "code", "formats"])
def test_what_would_be_another_dance_is_made_anew(folder, capsys, monkeypatch, change):
    dance(capsys, "songs")
    more = []
    if change == "option":
        more = ["--seed", "3"]
    elif change == "song":
        song = Music.load("songs/b.wav")
        Music(song.audio * 0.5, song.rate, "b").save("songs/b.wav")
    elif change == "model":
        path = folder / "tiny" / "model.safetensors"
        path.write_bytes(path.read_bytes()[:-2] + b"\0\0")
        many_songs.model_digest.cache_clear()
    elif change == "file":
        (folder / "out/c/dance.npz").unlink()
    elif change == "code":
        monkeypatch.setattr(many_songs, "code_digest", lambda packages: "other")
    else:
        (folder / "out/a/mine.txt").write_text("my own")
        assert main(["generate", "songs", "--model", "tiny", *SHORT, "--formats", "bvh"]) == 0
        assert (folder / "out/a/mine.txt").exists() and not (folder / "out/a/dance.npz").exists()
        assert (folder / "out/a/dance.1.bvh").exists()
        return
    said = dance(capsys, "songs", *more)
    changed = {"song": 1, "file": 1}.get(change, 3)
    assert (said["made"], said["kept"]) == (changed, 3 - changed)


OWN = """
from dancediff.diffusion.ddim import ddim_step
from dancediff.papers.tcdiffpp.model import TCDiffPP


class Mine(TCDiffPP):
    pass


def step(*where, **how):
    return ddim_step(*where, **how)
"""


@pytest.mark.parametrize("option", [["--own", "many_mine:Mine"], ["--sampler", "many_mine:step"]])
def test_after_a_change_of_ones_own_code_dances_are_made_anew(folder, capsys, monkeypatch, option):
    """They were kept: only the name of the code was known."""
    monkeypatch.syspath_prepend(folder)
    said = []
    for text in (OWN, OWN, f"{OWN}# changed\n"):
        (folder / "many_mine.py").write_text(text)
        monkeypatch.delitem(sys.modules, "many_mine", raising=False)
        said.append(dance(capsys, "songs/a.wav", "songs/b.wav", *option))
    assert [(one["made"], one["kept"]) for one in said] == [(2, 0), (0, 2), (2, 0)]


def test_a_bad_song_is_told_and_the_others_are_danced_to(folder, capsys):
    (folder / "songs/a.wav").write_text("no sound")
    (folder / "songs/d.wav").write_bytes(b"")
    assert main(["generate", "songs", "--model", "tiny", *SHORT[:-1]]) == 1
    said = capsys.readouterr()
    last = said.err.strip().splitlines()[-1]
    assert last.startswith("dancediff: 2 of 4 songs failed") and "4/4" in said.err
    assert "made 2, kept 0, failed 2" in said.out and "a: song" in said.out and "empty" in said.out
    assert sorted(p.name for p in (folder / "out").iterdir()) == ["b", "c"]
    again = dance(capsys, "songs", status=1)
    assert again["kept"] == 2 and sorted(again["failed"]) == ["a", "d"]


def test_a_process_loads_a_model_once(folder, capsys, monkeypatch):
    loads = []

    def load(name, load=hub.load, **how):
        loads.append(name)
        return load(name, **how)

    monkeypatch.setattr(hub, "load", load)
    dance(capsys, "songs")
    assert len(loads) == 1


def test_each_dance_is_measured_with_the_beats_of_its_own_song(folder, capsys):
    dance(capsys, "songs")
    path = folder / "out/b/dance.npz"
    beats = Music.load("songs/b.wav").beats()
    assert np.array_equal(read_arrays(path, ("beats",))["beats"], beats)
    assert read_dance(path).name == "b" and np.array_equal(read_dance(path).beats, beats)


def test_a_song_alone_is_danced_to_as_before(folder, capsys):
    said = dance(capsys, "songs/a.wav")
    assert sorted(p.name for p in (folder / "out").iterdir()) == ["dance.npz"]
    assert said["files"] == ["out/dance.npz"] and "beats" not in np.load("out/dance.npz")


def test_a_full_disk_ends_the_run(folder, capsys, monkeypatch):
    def full(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(many_songs, "dance_to", full)
    assert main(["generate", "songs", "--model", "tiny", *SHORT]) == 2
    assert "No space left" in capsys.readouterr().err


def test_a_machine_with_other_code_or_another_disk_is_told(folder):
    row = many_songs.SongRow("a", "songs/a.wav", "tiny")
    job = many_songs.DanceJob(row, folder / "a", folder, ["npz"], "other")
    with pytest.raises(RuntimeError, match="another version of dancediff"):
        many_songs.make_dance(job)
    job = many_songs.DanceJob(row, folder / "x/a", folder / "x", ["npz"], "other")
    with pytest.raises(RuntimeError, match="that all machines see"):
        many_songs.make_dance(job)
