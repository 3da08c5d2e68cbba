"""Many dances one after the other, and many at once: no memory is lost, nobody waits for ever."""

import gc
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from dancediff import hub

LONG = os.environ.get("DANCEDIFF_TRUST") == "long"
REQUESTS = {"tcdiffpp": 200, "lodge": 200} if LONG else {"tcdiffpp": 20, "lodge": 10}
PROCESSES = 8 if LONG else 3
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]


def resident() -> float:
    """Memory that this process has now, MiB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def held() -> int:
    """Bytes of all tensors there are."""
    gc.collect()
    tensors = [x for x in gc.get_objects() if type(x) in (torch.Tensor, torch.nn.Parameter)]
    storages = {x.untyped_storage().data_ptr(): x.untyped_storage().nbytes() for x in tensors}
    return sum(storages.values())


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads /proc, which is Linux's")
@pytest.mark.parametrize("name", ["tcdiffpp", "lodge"])
def test_memory_stays_flat(name, record_property):
    model, song = hub.load(name), hub.packaged_song().slice(0, 3)
    options = {"seconds": 2, "steps": 2} | ({"dancers": 2} if name == "tcdiffpp" else {})
    sizes = []
    for k in range(REQUESTS[name]):
        model.generate(song, seed=k, **options)
        if k % (REQUESTS[name] // 10) == 0:
            gc.collect()
            sizes.append(resident())
    grown, before = sizes[-1] - sizes[2], held()  # caches are full by then
    for seed in (1, 2):
        model.generate(song, seed=seed, **options)
    text = ", ".join(f"{size:.0f}" for size in sizes)
    record_property("trust", f"{REQUESTS[name]} requests to {name}: memory {text} MiB")
    assert grown < 40
    assert held() - before < 50_000, "tensors of a dance are kept; one is 100,000 bytes"


def test_many_processes_at_once(tmp_path, record_property):
    """More of them than cores; the same request gives all of them the same dance."""
    words = ["generate", "packaged", "--seconds", "3", "--steps", "4", "--formats", "npz", "--out"]
    command = [sys.executable, "-m", "dancediff.cli", *words]
    begun = time.monotonic()
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    running = [subprocess.Popen([*command, tmp_path / str(k)], **quiet) for k in range(PROCESSES)]
    for process in running:
        _, words = process.communicate(timeout=600)
        assert process.returncode == 0, words.decode()[-500:]
    dances = {(tmp_path / str(k) / "dance.npz").read_bytes() for k in range(PROCESSES)}
    assert len(dances) == 1
    took = time.monotonic() - begun
    record_property(
        "trust", f"{PROCESSES} processes at once on {os.cpu_count()} cores: done after {took:.0f} s"
    )


@pytest.mark.parametrize("name", ["tcdiffpp", "lodge"])
def test_number_of_threads_hardly_matters(name, record_property):
    model, song = hub.load(name), hub.packaged_song().slice(0, 8)
    before, dances = torch.get_num_threads(), []
    try:
        for threads in (1, 2):
            torch.set_num_threads(threads)
            dances.append(model.generate(song, seconds=6, seed=1).joints())
    finally:
        torch.set_num_threads(before)
    apart = (dances[0] - dances[1]).norm(dim=-1).max().item()  # metres
    record_property("trust", f"{name}, 1 thread or 2: joints {apart:.1e} m apart (6 s, seed 1)")
    assert apart < 1e-4
