"""`dancediff prepare`, as a user meets it."""

import json
from collections import Counter

import pytest

from dancediff.cli import main
from dancediff.data import sources
from dancediff.data.prepared import PreparedData
from dancediff.data.sources import SOURCES, source_jobs
from dancediff.data.summary import Summary


def last_line(capsys):
    return capsys.readouterr().err.strip().splitlines()[-1]


def test_choreograph_from_the_command_line(tmp_path, capsys):
    args = ["prepare", "choreograph", "3", str(tmp_path / "out"), "--seconds", "5"]
    assert main(args) == 0
    out = capsys.readouterr().out
    assert "synthetic" in out and "made 3, kept 0, skipped 0" in out
    assert len(PreparedData(tmp_path / "out")) == 3
    assert main([*args, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["made"], facts["kept"], facts["skipped"]) == (0, 3, {})
    assert main([*args, "--seed", "1", "--json"]) == 0
    assert len(PreparedData(tmp_path / "out")) == 6


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["aioz", "nowhere", "out"], ["'nowhere' is no folder"]),
        (["choreograph", "many", "out"], ["'many'", "number of dances"]),
        (["choreograph", "0", "out"], ["num=0"]),
        (["choreograph", "3", "out", "--seconds", "1"], ["seconds=1"]),
        (["choreograph", "3", "out", "--workers", "0"], ["workers=0"]),
        (["choreograph", "3", "out", "--backend", "spark"], ["--backend 'spark'", "loky, dask"]),
        (["choreograph", "3", "out", "--workers", "two"], ["--workers 'two'", "whole number"]),
        (["choreograph", "3"], ["prepare --help"]),
        (["ballet", "src", "out"], ["ballet", "prepare --help"]),
        (["cmu", ".", "out"], ["manifest.json"]),
        (["choreograph", "3", "file"], ["DST 'file'", "folder"]),
    ],
)
def test_bad_arguments(tmp_path, capsys, monkeypatch, args, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("in the way")
    assert main(["prepare", *args]) == 2
    line = last_line(capsys)
    assert line.startswith("dancediff: ") and all(word in line for word in words), line
    assert not (tmp_path / "out").exists()


def test_nothing_prepared_is_exit_status_one(tmp_path, capsys):
    lists, motions = tmp_path / "src", tmp_path / "src" / "motions_smpl"
    motions.mkdir(parents=True)
    (motions / "video_01_0_100.pkl").write_bytes(b"no pickle")
    (lists / "train_split_sequence_names.txt").write_text("video_01_0_100\n")
    assert main(["prepare", "aioz", str(lists), str(tmp_path / "out")]) == 1
    told = capsys.readouterr()
    assert "aioz_video_01_0_100: " in told.out and "skipped 1" in told.out
    assert "none of the 1 takes could be prepared" in told.err.splitlines()[-1]


def test_every_source_has_a_reader(tmp_path):
    assert set(SOURCES) == {"aioz", "finedance", "aistpp", "cmu", "choreograph", "songs", "folder"}
    with pytest.raises(ValueError, match=str(tmp_path)):
        sources.prepare_source("folder", tmp_path, tmp_path / "out")
    for name in set(SOURCES) - {"choreograph", "folder"}:
        with pytest.raises(ValueError, match=str(tmp_path)):
            source_jobs(name, tmp_path)  # an empty folder
    with pytest.raises(ValueError, match="source='edge'"):
        source_jobs("edge", tmp_path)


def test_mocap_gets_music_and_company(tmp_path, monkeypatch):
    """The steps of `prepare cmu`, on takes that take no time to read."""
    from test_composed import Again, take

    from dancediff.data.take import Job

    takes = [take(f"d{k}", k, 2, "train") for k in range(2)] + [take("solo", 5, 1, "val")]
    monkeypatch.setattr(
        sources, "source_jobs", lambda *_, **__: [Job(t.name, Again(t)) for t in takes]
    )
    summary = sources.prepare_source("cmu", tmp_path, tmp_path / "out", progress=False)
    assert summary.made == 3 + 1 + 3 and summary.skipped == {}
    data = PreparedData(tmp_path / "out")
    assert {entry.music for entry in data} == {"beat-aligned synthetic"}
    assert {(entry.kind, entry.dancers) for entry in data} == {
        ("real", 1), ("real", 2), ("composed", 3), ("composed", 4), ("composed", 5)
    }  # fmt: skip
    assert data.by_name["d0"].songs == 3


def test_what_cannot_be_trained_on_is_said_at_once(tmp_path, capsys):
    """Of one song all dances are in one split, and song 1 is in val; training would fail later."""
    args = ["prepare", "choreograph", "2", str(tmp_path / "data"), "--seconds", "5", "--seed", "1"]
    assert main(args) == 0
    assert "0 takes are to train on, 2 in val" in capsys.readouterr().out
    assert main([*args, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["lacks"]
    counts = {("real", music, 2): Counter(takes=1, train=1) for music in ("none", "original")}
    assert Summary(tmp_path, counts=counts).lacks == []
    del counts["real", "original", 2]
    assert "no take has music" in str(Summary(tmp_path, counts=counts))


def test_split_is_an_option_of_finedance(tmp_path, capsys):
    assert main(["prepare", "finedance", str(tmp_path), "out", "--split", "dancer"]) == 2
    assert "unpack FineDance there" in last_line(capsys)
    assert main(["prepare", "aioz", str(tmp_path), "out", "--split", "dancer"]) == 2
    assert "split='dancer' is no option of aioz" in last_line(capsys)


def test_train_reads_a_prepared_folder(tmp_path, capsys):
    assert main(["prepare", "choreograph", "4", str(tmp_path / "data"), "--seconds", "6"]) == 0
    config = tmp_path / "c.toml"
    config.write_text(
        "[model]\nd_model = 32\nnum_layers = 1\nnum_heads = 2\nff_dim = 64\nfusion_hidden = 64\n"
        "num_frames = 60\n[train]\nsteps = 2\n[data]\ndancers_per_batch = 4\n"
    )
    args = ["train", str(config), "--data", str(tmp_path / "data"), "--out", str(tmp_path / "run")]
    assert main(args) == 0
    card = (tmp_path / "run" / "model" / "card.md").read_text()
    assert "the takes in data" in card and str(tmp_path) not in card
    text = config.read_text()  # the folder may stand in the config as well
    config.write_text(text.replace("[data]", f"[data]\nfolder = '{tmp_path / 'data'}'"))
    assert main(["train", str(config), "--out", str(tmp_path / "other")]) == 0
    assert "Trained on the takes in data" in (tmp_path / "other" / "model" / "card.md").read_text()
    config.write_text(text)
    capsys.readouterr()
    args[3] = str(tmp_path)
    assert main(args) == 2 and "holds a training" in last_line(capsys)
    args.append("--overwrite")
    assert main(args) == 2 and "no folder of prepared data" in last_line(capsys)
    config.write_text(config.read_text().replace("60", "600"))
    args[3] = str(tmp_path / "data")
    assert main(args) == 2 and "600 frames" in last_line(capsys)
