"""A program's end waits for threads that compute, and does not hang on them."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

from dancediff.threads import begun_beside

HEARS = """
import numpy as np
from dancediff.generation.opening import Opening
from dancediff.music.song import Music
song = Music(np.random.default_rng(0).uniform(-1, 1, 60 * 15360).astype(np.float32), 15360)
def hear(self):
    self.song.features()
    print("all heard", flush=True)
Opening._hear = hear
opening = Opening(song, 20)
opening.features_until(1)  # libraries cannot be loaded any more when a program ends
opening.compute_features()
"""

DANCES = """
import torch
from dancediff.live_dance.session import LiveSession
from dancediff.music.synth import synth_song
from tiny_tcdiffpp import tiny_tcdiffpp
run = LiveSession._run
def watched(self):
    run(self)
    print("danced", len(self._pieces), flush=True)
LiveSession._run = watched
session = LiveSession(tiny_tcdiffpp(), synth_song(2, seconds=40.0)[0], dancers=2, steps=8).start()
while not session._pieces:
    session.join(0.01)
"""

FAILS = """
from dancediff.threads import Worker
worker = Worker(int, "x", stop=lambda: print("told to stop"))
try:
    worker.begin().join()
finally:
    import threading
    assert threading.active_count() == 1
"""


def ended(program: str) -> subprocess.CompletedProcess:
    code = f"import sys; sys.path[:] = {sys.path!r}\n{program}"
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=False
    )


def test_a_song_that_is_heard_is_not_cut_off():
    end = ended(HEARS)
    assert (end.returncode, end.stdout) == (0, "all heard\n"), end.stderr


def test_where_no_thread_starts_any_more_work_is_done_at_once(monkeypatch):
    def refuse(self, work):
        raise RuntimeError("cannot schedule new futures after interpreter shutdown")

    monkeypatch.setattr(ThreadPoolExecutor, "submit", refuse)
    done = []
    result = begun_beside(lambda: done.append(1) or 7)
    assert done == [1] and result() == 7


def test_a_dance_is_told_to_stop():
    end = ended(DANCES)
    assert end.returncode == 0 and end.stderr == ""
    assert end.stdout.startswith("danced ") and int(end.stdout.split()[1]) < 16  # of 40 s


def test_who_has_ended_is_told_nothing():
    end = ended(FAILS)
    assert end.returncode == 0 and end.stdout == "" and "ValueError" in end.stderr
