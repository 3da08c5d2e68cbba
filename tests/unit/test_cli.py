"""The command line as a user meets it: exit status, last line, files."""

import json
import subprocess
import sys
import time

import numpy as np
import pytest
import soundfile

from dancediff.cli import main


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
        (["noise.wav", "--dancers", "0"], ["dancers=0", "1 ... 5"]),
        (["noise.wav", "--dancers", "9"], ["dancers=9", "1 ... 5"]),
        (["noise.wav", "--seconds", "-3"], ["seconds=-3"]),
        (["noise.wav", "--seconds", "99"], ["seconds=99", "3.00"]),
        (["noise.wav", "--seed", "1.5"], ["1.5", "--help"]),
        (["noise.wav", "--steps", "0"], ["steps=0"]),
        (["noise.wav", "--model", "nobody"], ["'nobody'", "tcdiffpp"]),
        (["noise.wav", "--formats", "npz,exe"], ["'exe'", "npz,mp4,png"]),
        (["noise.wav", "--swap", "0", "0", "1"], ["swap"]),
    ],
)
def test_bad_input(songs, capsys, monkeypatch, args, words):
    monkeypatch.chdir(songs)
    assert main(["generate", *args, "--out", "out"]) == 2
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert all(word in last for word in words), last
    assert not (songs / "out").exists()


@pytest.mark.parametrize("out", ["file", "file/below", "/proc/out"])
def test_bad_output_folder(songs, capsys, monkeypatch, out):
    monkeypatch.chdir(songs)
    assert main(["generate", "noise.wav", "--out", out]) == 2
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert out.split("/")[0] in last and "folder" in last
    assert (songs / "file").read_text() == "in the way"


def test_generate_writes_what_it_says(songs, capsys, monkeypatch):
    monkeypatch.chdir(songs)
    args = ["generate", "noise.wav", "--dancers", "2", "--seconds", "2", "--steps", "4", "--json"]
    assert main([*args, "--out", "out", "--formats", "npz,png"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["frames"] == 60
    assert sorted(p.name for p in (songs / "out").iterdir()) == ["dance.npz", "dance.png"]


def test_a_failed_write_leaves_nothing(songs, capsys, monkeypatch):
    from dancediff.motion.motion import Motion

    def fail(self, path, song=None):
        path.write_bytes(b"half")
        raise OSError("disk full")

    monkeypatch.chdir(songs)
    monkeypatch.setattr(Motion, "save", fail)
    args = ["generate", "noise.wav", "--seconds", "2", "--steps", "2", "--formats", "npz"]
    assert main([*args, "--out", "a/b"]) == 2
    assert "disk full" in capsys.readouterr().err and not (songs / "a").exists()


def test_help_is_quick_and_has_no_traceback():
    start = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "dancediff.cli", "generate", "--help"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0 and "--dancers" in done.stdout
    assert time.monotonic() - start < 5  # a loaded machine; alone it is under one second


def test_help_does_not_import_torch():
    code = (
        "import sys; from dancediff.cli import main\n"
        "try: main(['generate', '--help'])\n"
        "except SystemExit: print('torch' in sys.modules, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == "False"
