"""``kill -9`` at random moments: every file is whole, and going on gives the bytes of no kill."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from safetensors import safe_open
from tiny_training import tiny_config

from dancediff.arrays import read_arrays
from dancediff.data.choreographer import choreograph
from dancediff.music.synth import synth_song

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1200),
    pytest.mark.skipif(os.name == "nt", reason="SIGKILL is of Unix"),
]
LONG = os.environ.get("DANCEDIFF_TRUST") == "long"
FORMATS = "npz,png,html,glb,bvh,mp4"
COMMANDS = {
    "train": "train CONFIG --resume --out OUT",
    "prepare": "prepare choreograph 6 OUT --seconds 8 --workers 2",
    "songs": "generate SONGS --seconds 3 --steps 3 --formats npz,png --workers 2 --out OUT",
    "evaluate": "evaluate DANCES --workers 2 --json --keep OUT",
    "generate": f"generate packaged --seconds 3 --steps 3 --formats {FORMATS} --out OUT",
}
KILLS = (
    {"train": 20, "prepare": 15, "songs": 15, "evaluate": 15, "generate": 15}
    if LONG
    else dict.fromkeys(COMMANDS, 1)
)


def files(folder: Path) -> list[Path]:
    """What has a name of its own; hidden files are what a killed program was writing."""
    found = (path for path in folder.rglob("*") if path.is_file())
    return sorted(
        p for p in found if not any(n.startswith(".") for n in p.relative_to(folder).parts)
    )


def content(folder: Path) -> dict[str, bytes]:
    """The final bytes, without the clock's column of the losses."""
    out = {}
    for path in files(folder):
        data = path.read_bytes()
        if path.suffix == ".csv":
            rows = [line.split(b",") for line in data.splitlines()]
            data = b"\n".join(b",".join(row[:1] + row[2:]) for row in rows)
        out[str(path.relative_to(folder))] = data
    return out


def check_whole(path: Path) -> None:
    """Raises when a file is half of one."""
    assert path.stat().st_size > 0, path
    if path.suffix == ".safetensors":
        with safe_open(path, "pt") as file:
            for key in file.keys():
                file.get_tensor(key)
    elif path.suffix == ".npz":
        read_arrays(path)
    elif path.suffix == ".json":
        json.loads(path.read_text(encoding="utf-8"))
    elif path.suffix == ".png":
        Image.open(path).load()
    elif path.suffix == ".html":
        assert path.read_text(encoding="utf-8").rstrip().endswith("</html>")
    elif path.suffix == ".csv":
        commas = {line.count(",") for line in path.read_text(encoding="utf-8").splitlines()}
        assert len(commas) == 1, f"{path} has half a line"
    elif path.suffix == ".glb":
        data = path.read_bytes()
        assert data[:4] == b"glTF" and int.from_bytes(data[8:12], "little") == len(data), path
    elif path.suffix == ".bvh":
        _, rows = path.read_text(encoding="utf-8").split("MOTION\n")
        count, _, *frames = rows.strip().splitlines()
        assert int(count.split()[-1]) == len(frames), path
        assert len({len(frame.split()) for frame in frames}) == 1, path
    elif path.suffix == ".mp4":
        assert b"moov" in boxes(path.read_bytes()), path
    else:
        raise AssertionError(f"nobody looks into {path}")


def boxes(data: bytes) -> list[bytes]:
    """Names of the parts of a film; their sizes must add up to that of the file."""
    names, at = [], 0
    while at < len(data):
        size, name = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        names.append(name)
        at += size or len(data)
    assert at == len(data), "the last part is cut off"
    return names


@pytest.mark.parametrize("name", COMMANDS)
def test_nothing_is_lost(name, tmp_path, record_property):
    (tmp_path / "a.toml").write_text(tiny_config(60, 7))
    out, rng = tmp_path / "out", random.Random(name)
    fill = {"OUT": str(out), "CONFIG": str(tmp_path / "a.toml"), "SONGS": str(tmp_path / "songs")}
    (tmp_path / "songs").mkdir()
    for seed in range(5 if name == "songs" else 0):
        synth_song(seed, seconds=4)[0].save(tmp_path / "songs" / f"{seed}.wav")
    fill["DANCES"] = str(tmp_path / "dances")
    for seed in range(24 if name == "evaluate" else 0):
        (tmp_path / "dances").mkdir(exist_ok=True)
        dance, _ = choreograph(np.arange(0.2, 21, 0.5), dancers=3, seed=seed, seconds=20)
        dance.save(tmp_path / "dances" / f"{seed}.npz")
    command = [
        sys.executable,
        "-m",
        "dancediff.cli",
        *(fill.get(word, word) for word in COMMANDS[name].split()),
    ]

    def start():
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen(command, start_new_session=True, **quiet)

    begun = time.monotonic()
    assert start().wait(600) == 0
    whole, length = content(out), time.monotonic() - begun
    assert whole
    killed = ended = looked = 0
    shutil.rmtree(out)
    while killed < KILLS[name]:
        running = start()
        try:
            assert running.wait(rng.uniform(0.1, 1.1) * length) == 0
        except subprocess.TimeoutExpired:
            os.killpg(running.pid, signal.SIGKILL)  # its workers, too
            running.wait()
            killed += 1
            for path in files(out):
                check_whole(path)
                looked += 1
            continue
        assert content(out) == whole
        ended += 1
        shutil.rmtree(out)
    assert start().wait(600) == 0
    assert content(out) == whole
    record_property(
        "trust",
        f"kill -9, {name}: {killed} kills, {looked} files looked at in between, all whole; "
        f"{ended + 1} runs came to an end, all with the bytes of an unbroken one",
    )
