"""A process that dances to song after song needs no more memory for the last than for the 20th."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dancediff import hub
from tiny_tcdiffpp import tiny_tcdiffpp

SONGS = 200 if os.environ.get("DANCEDIFF_TRUST") == "long" else 50
MAY_GROW = 5  # MiB in 30 songs; kept songs of 4 s would be 10, kept models or figures more
CODE = """
import ctypes, gc, sys
from pathlib import Path
import numpy as np
from dancediff.cli.many_songs import CODE, DanceJob, SongRow, code_digest, make_dance
from dancediff.music.song import Music

folder, songs = Path(sys.argv[1]), int(sys.argv[2])
rng = np.random.default_rng(0)
for k in range(songs):
    sound = 0.1 * rng.normal(size=22050 * 4).astype(np.float32)
    song = Music(sound, 22050, str(k)).save(folder / f"{k}.wav")
    row = SongRow(str(k), str(song), str(folder / "tiny"), {"steps": 1})
    job = DanceJob(row, folder / str(k), folder, ["npz", "png", "html"], code_digest(CODE))
    assert make_dance(job)[0] == "made"
    if k in (19, songs - 1):
        gc.collect()  # garbage that waits for its collection would be 0 to 150 MiB, by chance
        ctypes.CDLL(None).malloc_trim(0)  # and freed memory is kept by the C library
        lines = Path("/proc/self/status").read_text().splitlines()
        print(next(line.split()[1] for line in lines if line.startswith("VmRSS")))
"""
pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1200),
    pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux"),
]


def test_memory_is_flat(tmp_path, record_property):
    hub.save_model(tiny_tcdiffpp().model, tmp_path / "tiny")
    command = [sys.executable, "-c", CODE, str(tmp_path), str(SONGS)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    early, late = (int(words) / 1024 for words in done.stdout.split())
    assert late < early + MAY_GROW, (early, late)
    record_property(
        "trust", f"{SONGS} songs in one process: {early:.0f} MiB after 20, {late:.0f} at the end"
    )
