"""Jobs on the processes of this machine; the clusters are in tests/cluster."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
import torch

from dancediff.backends import TRIES, WorkerDied, _start, check_backend, run_jobs


def square(x):
    return x * x, os.getpid(), torch.get_num_threads()


def dies(x, folder, often):
    """Kill the process that computes job 2, so many times."""
    time.sleep(0.05)
    if x == 2 and len(list(folder.iterdir())) < often:
        (folder / f"{time.time_ns()}").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def fails(x):
    if x == 2:
        raise OSError(28, "No space left on device")
    return x


def test_results_come_with_the_numbers_of_their_jobs():
    alone = dict(run_jobs(square, range(5)))
    assert {k: value[0] for k, value in alone.items()} == {0: 0, 1: 1, 2: 4, 3: 9, 4: 16}
    assert {value[1:] for value in alone.values()} == {(os.getpid(), 1)}


def test_threads_are_as_before_afterwards():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        assert dict(run_jobs(square, [1]))[0][2] == 1
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_functions_of_a_notebook_run_in_other_processes():
    found = dict(run_jobs(lambda x: (x + 1, os.getpid()), range(4), workers=2))
    assert [found[k][0] for k in range(4)] == [1, 2, 3, 4]
    assert os.getpid() not in {pid for _, pid in found.values()}


@pytest.mark.skipif(os.name == "nt", reason="SIGKILL is of Unix")
@pytest.mark.parametrize("often", [1, TRIES])
def test_a_killed_process_costs_no_other_job(tmp_path, often):
    found = dict(run_jobs(partial(dies, folder=tmp_path, often=often), range(6), workers=2))
    two = found.pop(2)
    assert found == {k: k for k in (0, 1, 3, 4, 5)}
    assert isinstance(two, WorkerDied) if often == TRIES else two == 2


def alive(pid: int) -> bool:
    """Whether a process computes or could; a dead one that nobody asked for does not count."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def wait_until(true, seconds: float) -> None:
    for _ in range(int(seconds * 10)):
        if true():
            return
        time.sleep(0.1)
    raise AssertionError(f"not within {seconds} s")


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks Linux")
def test_no_process_outlives_a_killed_program(tmp_path):
    code = (
        "import os, sys, time\n"
        "from pathlib import Path\n"
        "from dancediff.backends import run_jobs\n"
        "def wait(folder): (Path(folder) / str(os.getpid())).touch(); time.sleep(60)\n"
        "list(run_jobs(wait, sys.argv[1:], workers=2))"
    )
    program = subprocess.Popen([sys.executable, "-c", code, str(tmp_path), str(tmp_path)])
    wait_until(lambda: len(list(tmp_path.iterdir())) == 2, 60)
    program.kill()
    program.wait()
    pids = [int(path.name) for path in tmp_path.iterdir()]
    wait_until(lambda: not any(map(alive, pids)), 15)


@pytest.mark.parametrize("workers", [1, 2])
def test_what_a_job_raises_ends_the_run(workers):
    with pytest.raises(OSError, match="No space left"):
        list(run_jobs(fails, range(6), workers=workers))


def test_a_job_may_run_jobs():
    assert dict(run_jobs(lambda x: dict(run_jobs(abs, [x])), [-3]))[0] == {0: 3}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((0, "loky"), "workers=0 must be at least 1"),
        ((1, "spark"), "backend='spark' is not one of loky, dask, ray"),
        ((1, "loky", "host:1"), "scheduler='host:1' goes with"),
    ],
)
def test_bad_arguments_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        check_backend(*options)


@pytest.mark.parametrize(("backend", "module"), [("dask", "distributed"), ("ray", "ray")])
def test_a_missing_backend_says_what_to_install(monkeypatch, backend, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ValueError, match=r'pip install "dancediff\[cluster\]"'):
        check_backend(1, backend)


class SlowRay:
    """Ray on a computer that starts it only when it is asked the n-th time."""

    def __init__(self, starts_at):
        self.starts_at, self.asked, self.ended = starts_at, 0, 0

    def init(self, **how):
        self.asked += 1
        if self.asked < self.starts_at:
            raise Exception("The current node timed out\nduring startup.")

    def shutdown(self):
        self.ended += 1


def test_ray_is_started_again_when_it_was_late():
    ray = SlowRay(2)
    _start(ray, None, {"num_cpus": 1})
    assert (ray.asked, ray.ended) == (2, 1)


def test_a_computer_too_slow_for_ray_is_told_so():
    ray = SlowRay(3)
    with pytest.raises(RuntimeError, match=r"backend='ray' did not start .*timed out during"):
        _start(ray, None, {"num_cpus": 1})
    assert (ray.asked, ray.ended) == (2, 2)
