"""Dask and Ray, as they are: clusters of two worker processes on this machine.

They bring the bytes of loky, lose a job only when it kills its process each time, and say what is
wrong when there is no cluster. Everything runs in processes of its own, as a user starts it.
"""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from dancediff import hub
from dancediff.music.song import Music
from tiny_tcdiffpp import tiny_tcdiffpp

HERE = Path(__file__).parent
MODULES = {"dask": "distributed", "ray": "ray"}
REQUIRED = "cluster" in os.environ.get("DANCEDIFF_REQUIRE", "")
ENVIRONMENT = {
    "PYTHONPATH": os.pathsep.join([str(HERE), *filter(None, sys.path)]),
    "RAY_AUTH_MODE": "token",  # what Ray asks for of itself, without a file in the home folder
    "RAY_AUTH_TOKEN": "0123456789abcdef" * 4,
    "RAY_USAGE_STATS_ENABLED": "0",
}

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(600),
    pytest.mark.skipif(os.name == "nt", reason="SIGKILL is of Unix"),
]


@pytest.fixture(params=MODULES)
def backend(request):
    if find_spec(MODULES[request.param]) is None and not REQUIRED:
        pytest.skip('needs pip install "dancediff[cluster]"')
    return request.param


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Five songs, of which one is broken, a model of random weights, and its dances by loky."""
    folder = tmp_path_factory.mktemp("cluster")
    rng = np.random.default_rng(0)
    (folder / "songs").mkdir()
    for name in "abcd":
        sound = 0.1 * rng.normal(size=22050 * 3).astype(np.float32)
        Music(sound, 22050, name).save(folder / "songs" / f"{name}.wav")
    (folder / "songs" / "broken.wav").write_text("no sound")
    hub.save_model(tiny_tcdiffpp().model, folder / "tiny")
    assert generate(folder, "--out", "loky", "--workers", "2").returncode == 1
    assert len(content(folder / "loky")) == 8
    return folder


def run(folder, *words, **environment):
    return subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env=os.environ | ENVIRONMENT | environment,
        capture_output=True,
        text=True,
        check=False,
    )


def generate(folder, *words, **environment):
    command = ["generate", "songs", "--model", "tiny", "--seconds", "2", "--steps", "2"]
    options = ["--formats", "npz", "--json"]
    return run(folder, "-m", "dancediff.cli", *command, *options, *words, **environment)


def content(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def danced(folder, name, *words, **environment):
    """All dances made anew, the broken song told, every byte as loky's."""
    done = generate(folder, "--out", name, *words, **environment)
    assert done.returncode == 1, done.stderr
    said = json.loads(done.stdout.splitlines()[-1])
    assert said["made"] == 4 and list(said["failed"]) == ["broken"]
    assert content(folder / name) == content(folder / "loky")


def test_a_cluster_of_this_machine_gives_the_same_bytes(folder, backend):
    danced(folder, backend, "--backend", backend, "--workers", "2")


def test_a_killed_worker_costs_only_its_job(tmp_path, backend):
    done = run(tmp_path, str(HERE / "deadly.py"), backend, str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-2:] == ["[0, 1, 2, 3, 4, 5, 6, 7]", "[4]"]


@pytest.mark.parametrize("address", ["127.0.0.1:1", "no port"])
def test_a_scheduler_that_is_not_there_is_told(folder, backend, address):
    done = generate(folder, "--out", "nowhere", "--backend", backend, "--scheduler", address)
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert last.startswith(f"dancediff: scheduler={address!r} cannot be reached"), last
    assert f"start the {backend} cluster first" in last


@contextlib.contextmanager
def running(*commands, log: Path):
    """Programs that run in the background, and end with all that they started."""
    with log.open("w") as file:
        started = [
            subprocess.Popen(
                [str(Path(sys.executable).parent / command[0]), *command[1:]],
                env=os.environ | ENVIRONMENT,
                stdout=file,
                stderr=file,
                start_new_session=True,
            )
            for command in commands
        ]
        try:
            yield started
        finally:
            for one in started:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(one.pid, signal.SIGTERM)
            for one in started:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    one.wait(20)
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(one.pid, signal.SIGKILL)
                one.wait()


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def wait_for(log: Path, words: str, seconds: float = 90) -> None:
    for _ in range(int(seconds * 10)):
        if len(re.findall(words, log.read_text())):
            return
        time.sleep(0.1)
    raise AssertionError(f"no {words!r} in {log.read_text()}")


def prepared_and_evaluated(folder, name, prepare, evaluate, **environment):
    """Three takes and their index, by file, and what `evaluate` says of them."""
    out = folder / f"takes_{name}"
    words = ["prepare", "choreograph", "3", str(out), "--seconds", "5", "--json", *prepare]
    done = run(folder, "-m", "dancediff.cli", *words)
    assert done.returncode == 0, done.stderr
    words = ["evaluate", str(out), "--json", *evaluate]
    done = run(folder, "-m", "dancediff.cli", *words, **environment)
    assert done.returncode == 0, done.stderr
    takes = {k: v for k, v in content(out).items() if not k.startswith("cache")}
    return takes, done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def of_one(folder):
    """Takes and scores of one process, without a cluster."""
    found = prepared_and_evaluated(folder, "one", ["--workers", "1"], ["--workers", "1"])
    assert len(found[0]) == 4  # three takes and the index
    return found


def finds_the_cluster(folder, of_one, backend, address):
    """One command is told where the cluster is, the next finds it in the environment."""
    how = ["--backend", backend]
    variable = {"dask": "DASK_SCHEDULER_ADDRESS", "ray": "RAY_ADDRESS"}[backend]
    found = prepared_and_evaluated(
        folder, backend, [*how, "--scheduler", address], how, **{variable: address}
    )
    assert found == of_one


def test_a_dask_cluster_that_runs_is_found_and_may_lose_a_machine(folder, of_one, tmp_path):
    if not REQUIRED:
        pytest.importorskip("distributed")
    port, log = free_port(), tmp_path / "log"
    address = f"tcp://127.0.0.1:{port}"
    work = ("dask", "worker", address, "--nthreads", "1", "--no-dashboard")
    work = (*work, "--local-directory", str(tmp_path))
    head = ("dask", "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    with running(head, work, work, log=log) as (_, *machines):
        finds_the_cluster(folder, of_one, "dask", address)
        os.killpg(machines[0].pid, signal.SIGKILL)  # as if it lost its power
        danced(folder, "dask_one_left", "--backend", "dask", "--scheduler", address)


def test_a_ray_cluster_that_runs_is_found(folder, of_one, tmp_path):
    if not REQUIRED:
        pytest.importorskip("ray")
    port, log = free_port(), tmp_path / "log"
    head = ("ray", "start", "--head", "--block", "--port", str(port), "--num-cpus", "2")
    head = (*head, "--node-ip-address", "127.0.0.1", "--include-dashboard", "false")
    with running(head, log=log):
        wait_for(log, "Ray runtime started")
        finds_the_cluster(folder, of_one, "ray", f"127.0.0.1:{port}")


def test_a_connected_dask_client_is_taken_and_survives_what_a_job_raises():
    """In a process of its own: the client is the user's, and its errors are those of the job."""
    if find_spec("distributed") is None and not REQUIRED:
        pytest.skip('needs pip install "dancediff[cluster]"')
    code = """
from distributed import Client
from dancediff.backends import run_jobs
if __name__ == "__main__":
    with Client(n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
        for jobs in (["7", "eight"], ["9"]):
            try:
                print(sorted(run_jobs(int, jobs, backend="dask")))
            except ValueError as err:
                print(err)
        print(client.status)
"""
    environment = os.environ | ENVIRONMENT
    how = {"env": environment, "capture_output": True, "text": True, "timeout": 300}
    made = subprocess.run([sys.executable, "-c", code], check=True, **how)
    lines = made.stdout.splitlines()
    assert "invalid literal" in lines[0] and lines[1:] == ["[(0, 9)]", "running"], made.stderr
