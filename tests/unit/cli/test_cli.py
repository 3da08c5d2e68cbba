"""The command line as a user meets it: exit status, last line, files."""

import errno
import json
import os
import subprocess
import sys
import time

import numpy as np
import pytest
import soundfile

from dancediff import __version__, hub
from dancediff.cli import _parse, main
from dancediff.cli.commands import COMMANDS
from dancediff.cli.files import write_all
from dancediff.cli.options import given
from dancediff.generation.pipeline import pipeline_of
from tiny_lodge import tiny_lodge
from tiny_tcdiffpp import tiny_tcdiffpp


@pytest.fixture(autouse=True)
def small_models(monkeypatch):
    """Models of random weights by the names of the packaged ones."""
    small = {"tcdiffpp": lambda: tiny_tcdiffpp().model, "lodge": tiny_lodge}

    def load(name, load=hub.load, **options):
        return pipeline_of(small[name](), name) if name in small else load(name, **options)

    monkeypatch.setattr(hub, "load", load)
    monkeypatch.setattr(hub, "packaged_models", lambda: sorted(small))


@pytest.fixture
def songs(tmp_path):
    rng = np.random.default_rng(0)
    tone = 0.1 * rng.normal(size=44100 * 3).astype(np.float32)
    soundfile.write(tmp_path / "noise.wav", tone, 44100)
    soundfile.write(tmp_path / "short.wav", tone[:8820], 44100)
    soundfile.write(tmp_path / "silent.wav", 0 * tone, 44100)
    (tmp_path / "empty.wav").write_bytes(b"")
    (tmp_path / "text.wav").write_text("this is no song")
    (tmp_path / "corrupt.ogg").write_bytes(
        b"OggS" + bytes(rng.integers(0, 256, 400, dtype=np.uint8))
    )
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "hollow").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["missing.wav"], ["missing.wav", "does not exist"]),
        (["empty.wav"], ["empty.wav", "empty"]),
        (["text.wav"], ["text.wav", "convert"]),
        (["corrupt.ogg"], ["corrupt.ogg", "convert"]),
        (["silent.wav"], ["silent"]),
        (["short.wav"], ["0.20 s", "at least"]),
        (["noise.wav", "--dancers", "0"], ["dancers=0", "at least 1"]),
        (["noise.wav", "--dancers", "9"], ["dancers=9", "1 ... 5"]),
        (["noise.wav", "--seconds", "-3"], ["seconds=-3"]),
        (["noise.wav", "--seconds", "99"], ["seconds=99", "3.00"]),
        (["noise.wav", "--seed", "1.5"], ["--seed '1.5'", "whole number"]),
        (["noise.wav", "--seed=1e3"], ["--seed '1e3'", "whole number"]),
        (["noise.wav", "--seed", "-1"], ["seed=-1"]),
        (["noise.wav", "--dancers", "three"], ["--dancers 'three'", "whole number"]),
        (["noise.wav", "--seconds", "long"], ["--seconds 'long'", "a number"]),
        (["noise.wav", "--seconds", "nan"], ["seconds=nan"]),
        (["noise.wav", "--swap", "a", "b"], ["--swap 'a b'", "whole numbers"]),
        (["noise.wav", "--sede", "1"], ["--sede", "do you mean --seed?"]),
        (["noise.wav", "--sampler", "euler"], ["sampler='euler'", "one of 'dpm', 'ddim', 'ddpm'"]),
        (["noise.wav", "--preset", "best"], ["--preset 'best'", "one of packaged, paper"]),
        (["hollow"], ["'hollow'", "wav, flac"]),
        (["noise.wav", "noise.wav"], ["2 dances", "'noise'", "manifest"]),
        (["list.csv"], ["list.csv", "does not exist"]),
        (["noise.wav", "--workers", "0"], ["workers=0"]),
        (["noise.wav", "--workers", "2", "--model", "nobody"], ["'nobody'", "tcdiffpp"]),
        (["noise.wav", "--backend", "spark"], ["--backend 'spark'", "loky, dask"]),
        (["noise.wav", "--scheduler", "host:1"], ["scheduler='host:1'", "dask and ray only"]),
        (["noise.wav", "--steps", "0"], ["steps=0"]),
        (["noise.wav", "--model", "nobody"], ["'nobody'", "tcdiffpp"]),
        (["noise.wav", "--formats", "npz,exe"], ["'exe'", "npz,mp4,png,html,glb,bvh,smpl"]),
        (["noise.wav", "--swap", "0", "0", "1"], ["swap"]),
    ],
)
def test_bad_input(songs, capsys, monkeypatch, args, words):
    monkeypatch.chdir(songs)
    assert main(["generate", *args, "--out", "out"]) == 2
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert all(word in last for word in words), last
    assert last.startswith("dancediff: ") and not (songs / "out").exists()


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ([], ["choose a command", "generate", "train"]),
        (["dance", "song.wav"], ["'dance' is no command", "generate"]),
        (["generate"], ["generate", "wav, flac"]),
        (["train", "missing.toml"], ["missing.toml", "does not exist", "tcdiffpp_small"]),
        (["train", "text.wav"], ["text.wav", "no TOML"]),
    ],
)
def test_bad_commands(songs, capsys, monkeypatch, args, words):
    monkeypatch.chdir(songs)
    assert main(args) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and all(word in lines[0] for word in words), lines
    assert not (songs / "runs").exists()


def test_mp4_without_its_extra_is_noticed_before_dancing(songs, capsys, monkeypatch):
    monkeypatch.chdir(songs)
    monkeypatch.setitem(sys.modules, "av", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["generate", "missing.wav"]) == 1
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert "dancediff[video]" in last and "npz,png" in last


@pytest.mark.parametrize("out", ["file", "file/below", "/proc/out", "x" * 300])
def test_bad_output_folder(songs, capsys, monkeypatch, out):
    monkeypatch.chdir(songs)
    assert main(["generate", "noise.wav", "--out", out]) == 2
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert out.split("/")[0] in last and ("folder" in last or "check the path" in last)
    assert (songs / "file").read_text() == "in the way"


def test_a_folder_where_a_file_should_go_is_noticed_before_dancing(songs, capsys, monkeypatch):
    monkeypatch.chdir(songs)
    (songs / "out" / "dance.png").mkdir(parents=True)
    assert main(["generate", "noise.wav", "--out", "out"]) == 2
    assert "dance.png" in capsys.readouterr().err
    assert [p.name for p in (songs / "out").iterdir()] == ["dance.png"]


def test_generate_writes_what_it_says(songs, capsys, monkeypatch):
    monkeypatch.chdir(songs)
    args = ["generate", "noise.wav", "--dancers", "2", "--seconds", "2", "--steps", "4", "--json"]
    assert main([*args, "--out", "out", "--formats", "npz,png"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["frames"] == 60
    assert sorted(p.name for p in (songs / "out").iterdir()) == ["dance.npz", "dance.png"]


def test_a_preset_and_an_option_beside_it(tmp_path, capsys):
    args = ["--dancers", "1", "--seconds", "1", "--steps", "2", "--formats", "npz", "--json"]
    args += ["--preset", "paper", "--eta", "0.5", "--dtype", "bfloat16", "--out", str(tmp_path)]
    assert main(["generate", "packaged", *args]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["preset"], said["sampler"], said["eta"]) == ("paper", "ddim", 0.5)
    assert said["steps"] == 2 and not said["foot_contact"] and said["dtype"] == "bfloat16"


def test_facts_are_those_of_the_whole_dance_and_not_of_its_last_piece(tmp_path, capsys):
    args = ["--dancers", "2", "--seconds", "6", "--steps", "1", "--formats", "npz", "--json"]
    assert main(["generate", "packaged", *args, "--swap", "1", "0", "--out", str(tmp_path)]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["seams"] == [150] and said["swap"] == [1, 0] and "whole" not in said


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == f"dancediff {__version__}"


def test_the_song_in_the_package_has_two_names(tmp_path, capsys):
    args = ["--dancers", "1", "--seconds", "1", "--steps", "1", "--formats", "npz", "--json"]
    for name in ("packaged", "studio_floor"):
        assert main(["generate", name, *args, "--out", str(tmp_path)]) == 0
        assert json.loads(capsys.readouterr().out)["song"] == "studio_floor"


@pytest.mark.parametrize("before", [[], ["dance.npz", "mine.txt"]])
def test_a_failed_write_leaves_everything_as_it_was(songs, capsys, monkeypatch, before):
    from dancediff.motion.motion import Motion

    def save_then_fail(self, path, song=None):
        path.write_bytes(b"half")
        if path.suffix == ".png":
            raise OSError("disk full")

    monkeypatch.chdir(songs)
    for name in before:
        (songs / "a/b").mkdir(parents=True, exist_ok=True)
        (songs / "a/b" / name).write_text("old")
    monkeypatch.setattr(Motion, "save", save_then_fail)
    args = ["generate", "noise.wav", "--seconds", "2", "--steps", "2", "--formats", "npz,png"]
    assert main([*args, "--out", "a/b"]) == 2
    assert "disk full" in capsys.readouterr().err
    assert (songs / "a").exists() == bool(before)
    left = {path.name: path.read_text() for path in (songs / "a/b").glob("*")}
    assert left == dict.fromkeys(before, "old")


def test_doctor_and_warm_speak_json(capsys):
    for command, key in (("doctor", "torch"), ("warm", "tempo")):
        assert main([command, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)[key]


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (
            ImportError('pip install "dancediff[video]"'),
            'dancediff: pip install "dancediff[video]"',
        ),
        (ModuleNotFoundError("No module named 'torch'"), "`dancediff doctor` says what is missing"),
    ],
)
def test_what_is_not_installed_is_said_without_a_traceback(error, said, capsys, monkeypatch):
    def missing():
        raise error

    monkeypatch.setattr("dancediff.cli.doctor.Doctor.run", lambda self: missing())
    assert main(["doctor"]) == 1
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--out", "--drift"])
def test_evaluate_names_the_option_whose_folder_is_a_file(option, tmp_path, capsys):
    (tmp_path / "a").write_text("")
    assert main(["evaluate", "dance.npz", option, str(tmp_path / "a" / "b")]) == 2
    assert f"{option} {str(tmp_path / 'a')!r}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["a.npz", "--out", "a.npz"], "--out 'a.npz' is read here"),
        ([".", "--out", "sub/../a.npz"], "--out 'sub/../a.npz' is read here"),
        (["sub/b.npz", "--reference", "a.npz", "--out", "a.npz"], "--out 'a.npz' is read here"),
        (["sub/b.npz", "--song", "a.png", "--drift", "a.png"], "--drift 'a.png' is read here"),
        (["a.npz", "--drift", "d.jpg"], "--drift 'd.jpg' is a picture; name a file in .png"),
        (["a.npz", "--out", "d.png", "--drift", "./d.png"], "--out and --drift are both 'd.png'"),
        (["nosuch.npz", "--out", "new/r.json"], "'nosuch.npz' does not exist"),
        (["nosuch.npz", "--drift", "new/d.png"], "'nosuch.npz' does not exist"),
        (["a.npz", "--out", "new/r.json"], "none of the 1 dances can be read"),
    ],
)
def test_evaluate_replaces_nothing_it_reads_and_leaves_nothing(
    words, said, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    for name in ("a.npz", "sub/b.npz", "a.png"):
        (tmp_path / name).write_text("kept")
    before = sorted(tmp_path.rglob("*"))
    assert main(["evaluate", *words]) == 2
    assert said in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == before
    assert all(path.read_text() == "kept" for path in before if path.is_file())


def test_none_is_told_from_an_option_that_is_not_given():
    for words, expected in ([], {}), (["--at-once", "None"], {"at_once": None}):
        assert given(_parse(["generate", "song.wav", *words])) == expected
    assert given(_parse(["generate", "song.wav", "--at-once", "4"])) == {"at_once": 4}


def test_the_doctor_reports_a_broken_torch(capsys, monkeypatch):
    from dancediff.cli import doctor

    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setattr(doctor, "CHECKS", {"machine": doctor.CHECKS["machine"]})
    assert main(["doctor"]) == 1
    said = capsys.readouterr()
    assert "✗ machine: ModuleNotFoundError" in said.out and doctor.SETUP in said.out
    assert "machine did not work" in said.err


def test_help_is_quick_and_has_no_traceback():
    before = os.times()
    done = subprocess.run(
        [sys.executable, "-m", "dancediff.cli", "generate", "--help"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0 and "--dancers" in done.stdout
    after = os.times()
    needed = sum(after[2:4]) - sum(before[2:4])  # CPU time of the child, whatever else runs
    assert needed < 5  # alone it is under one second


@pytest.mark.skipif(os.name != "posix", reason="pipes of Unix")
def test_a_reader_that_goes_away_is_no_error():
    """As in ``dancediff evaluate --json | head``."""
    command = [sys.executable, "-m", "dancediff.cli", "warm", "--json"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, **pipes) as program:
        program.stdout.close()
        said = program.stderr.read().decode()
    assert program.returncode == 141 and said == ""


def test_help_does_not_import_torch():
    code = (
        "import sys; from dancediff.cli import main\n"
        "try: main(['generate', '--help'])\n"
        "except SystemExit: print('torch' in sys.modules, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == "False"


def test_options_of_one_model_are_refused_for_another(songs, capsys):
    noise, out = str(songs / "noise.wav"), str(songs / "out")
    assert main(["generate", noise, "--soft", "0.5", "--out", out]) == 2
    said = capsys.readouterr().err
    assert "soft=0.5 is not for the model 'tcdiffpp'; models of lodge have it" in said
    for option, value in (("genre", "salsa"), ("energy", "0.5")):
        assert main(["generate", noise, f"--{option}", value, "--out", out]) == 2
        assert f"one with the extension '{option}_condition'" in capsys.readouterr().err


def test_what_killed_programs_left_is_removed_after_a_day(tmp_path):
    ages = {".dancediff-old": 2, ".dancediff-new": 0, "dances": 2}
    for name, days in ages.items():
        file = tmp_path / name / "dance.npz"
        file.parent.mkdir()
        file.touch()
        for path in (file, file.parent):
            os.utime(path, (time.time() - days * 86400,) * 2)
    write_all(tmp_path, lambda to: (to / "a.txt").write_text("a"))
    assert sorted(path.name for path in tmp_path.iterdir()) == [".dancediff-new", "a.txt", "dances"]


def test_the_bar_is_closed_before_an_error_is_told(songs, capsys, monkeypatch):
    def full(pieces, path):
        next(iter(pieces))
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("dancediff.io.pieces.save_pieces", full)
    options = ["--seconds", "2", "--steps", "1", "--formats", "npz", "--out", str(songs / "full")]
    assert main(["generate", str(songs / "noise.wav"), *options]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert "No space left" in last and "dancing" not in last


def test_a_port_in_use_is_no_matter_of_the_disk(songs, monkeypatch, capsys):
    def taken(command):
        raise OSError(errno.EADDRINUSE, "Address already in use")

    monkeypatch.setattr(COMMANDS["live"], "run", taken)
    assert main(["live", str(songs / "noise.wav"), "--port", "8123"]) == 2
    said = capsys.readouterr().err
    assert "name another port" in said and "free space" not in said


def test_a_config_that_comes_with_dancediff_explains_itself_by_name(tmp_path, monkeypatch, capsys):
    (tmp_path / "edge_tiny").mkdir()  # a folder of the same name is not the config
    monkeypatch.chdir(tmp_path)
    assert main(["train", "edge_tiny", "--explain"]) == 0
    assert "edge_tiny.toml sets what has a star" in capsys.readouterr().out


def test_any_genre_is_refused_by_who_must_have_one(songs, capsys):
    assert main(["generate", str(songs / "noise.wav"), "--model", "lodge", "--genre", "any"]) == 2
    assert "genre='any' is for models that dance without a genre, too" in capsys.readouterr().err


def test_files_of_an_older_group_do_not_join_the_new_one(tmp_path):
    def dancers(*names):
        return lambda folder: [(folder / name).touch() for name in names]

    kept = {"song.wav", "dance.9.smpl.npz"}
    for name in kept:
        (tmp_path / name).touch()
    write_all(tmp_path, dancers("dance.1.bvh", "dance.2.bvh", "dance.3.bvh"))
    write_all(tmp_path, dancers("dance.1.bvh", "dance.2.bvh"))
    assert {file.name for file in tmp_path.iterdir()} == kept | {"dance.1.bvh", "dance.2.bvh"}
    write_all(tmp_path, dancers("dance.bvh", "dance.npz"))
    assert {file.name for file in tmp_path.iterdir()} == kept | {"dance.bvh", "dance.npz"}


def test_what_is_danced_and_what_is_left_of_an_earlier_dance_is_said(songs, capsys):
    run = ["generate", str(songs / "noise.wav"), "--out", str(songs / "out"), "--seconds", "1"]
    run += ["--steps", "1", "--model", "lodge", "--genre", "Jazz"]
    assert main([*run, "--formats", "npz,png"]) == 0
    assert "danced as jazz):" in (said := capsys.readouterr().out) and "earlier" not in said
    assert main([*run, "--formats", "bvh"]) == 0
    assert "(of an earlier dance: dance.npz, dance.png)" in capsys.readouterr().out
