"""Many jobs at once: on processes of this machine, or on a Dask or Ray cluster.

Read first: docs/cluster.md.

Each job is computed in one thread, and sums in one thread have one order: results depend neither
on the backend, nor on the number of workers, nor on who computes what.
"""

import contextlib
import logging
import operator
import os
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Any

BACKENDS = {"loky": "joblib", "dask": "distributed", "ray": "ray"}  # and the module of each
TRIES = 3  # a job whose process dies so often is given up
SECONDS = 10  # to wait for a scheduler
EXAMPLES = {"dask": "tcp://host:8786", "ray": "host:6379"}
Outcomes = Generator[tuple[int, Any], None, None]
_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
_ONE_AT_A_TIME = threading.RLock()  # a Dask worker of several threads shares one model


class WorkerDied(RuntimeError):
    """In place of a result: the process died at each attempt, for instance for lack of memory."""

    def __init__(self):
        super().__init__(
            f"its process was killed {TRIES} times; is there enough memory for so many workers?"
        )


def check_backend(workers: int, backend: str, scheduler: str | None = None) -> None:
    """Refuse what cannot be meant, before any work is done.

    Raises: ValueError naming the argument.

    >>> check_backend(0, "loky")
    Traceback (most recent call last):
    ValueError: workers=0 must be at least 1
    """
    if operator.index(workers) < 1:
        raise ValueError(f"workers={workers} must be at least 1")
    if backend not in BACKENDS:
        raise ValueError(f"backend={backend!r} is not one of {', '.join(BACKENDS)}")
    if scheduler is not None and backend not in EXAMPLES:
        raise ValueError(f"scheduler={scheduler!r} goes with the backends dask and ray only")
    try:
        __import__(BACKENDS[backend])
    except ImportError as err:
        raise ValueError(
            f'backend={backend!r} is not installed; pip install "dancediff[cluster]", or leave '
            "it out"
        ) from err


def run_jobs(
    function: Callable,
    jobs: Sequence,
    *,
    workers: int = 1,
    backend: str = "loky",
    scheduler: str | None = None,
) -> Outcomes:
    """Call ``function(job)`` for every job: (number of the job, result) as each is ready.

    - ``workers``: so many processes; with "loky" one is this process itself. A running cluster
      has its own number.
    - ``scheduler``: the address of a running cluster. Without it a Dask client or Ray cluster that
      is connected is taken, then ``DASK_SCHEDULER_ADDRESS`` or ``RAY_ADDRESS``, else a cluster of
      this machine is started.

    A job whose process dies is tried again in another one, `TRIES` times in all; then its result is
    a `WorkerDied`. What ``function`` raises ends the run.

    Raises: ValueError as `check_backend`, and for a scheduler that cannot be reached; RuntimeError
    when Ray does not start on a computer that is too busy.

    >>> sorted(run_jobs(abs, [-1, 2]))
    [(0, 1), (1, 2)]
    """
    check_backend(workers, backend, scheduler)
    if backend == "dask":
        outcomes = _on_dask(function, jobs, workers, scheduler)
    elif backend == "ray":
        outcomes = _on_ray(function, jobs, workers, scheduler)
    elif workers == 1 or len(jobs) < 2:
        outcomes = _in_this_process(function, jobs)
    else:
        outcomes = _on_this_machine(function, jobs, min(workers, len(jobs)))
    with contextlib.closing(outcomes):
        for k, outcome in outcomes:
            if isinstance(outcome, _Raised):
                raise outcome.error
            yield k, outcome


class _Raised:
    """What a function raised, sent home as a result: each backend wraps errors in its own way."""

    def __init__(self, error: Exception):
        self.error = error


def call_in_one_thread(function: Callable, job):
    """``function(job)``, or what it raised."""
    with _ONE_AT_A_TIME, one_thread():
        try:
            return function(job)
        except Exception as err:
            return _Raised(err)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Sums over several threads round differently: one thread gives the same bytes everywhere."""
    import torch
    from threadpoolctl import threadpool_limits

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(threads)


def _in_this_process(function: Callable, jobs: Sequence) -> Outcomes:
    for k, job in enumerate(jobs):
        yield k, call_in_one_thread(function, job)


def _on_this_machine(function: Callable, jobs: Sequence, workers: int) -> Outcomes:
    """A pool of one process for each worker, so that a killed one costs no other its job."""
    from concurrent.futures import FIRST_COMPLETED, Future, wait
    from concurrent.futures.process import BrokenProcessPool

    from joblib.externals.loky import ProcessPoolExecutor

    def new_pool():
        ends = {"initializer": _end_with, "initargs": (os.getpid(),)}
        return ProcessPoolExecutor(1, env=dict.fromkeys(_THREADS, "1"), **ends)

    waiting = deque((k, 1) for k in range(len(jobs)))
    pools = [new_pool() for _ in range(workers)]
    free, running = deque(range(workers)), dict[Future, tuple[int, int, int]]()
    try:
        while waiting or running:
            while waiting and free:
                (k, attempt), pool = waiting.popleft(), free.popleft()
                running[pools[pool].submit(call_in_one_thread, function, jobs[k])] = (
                    k,
                    attempt,
                    pool,
                )
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                k, attempt, pool = running.pop(future)
                free.append(pool)
                try:
                    yield k, future.result()
                except BrokenProcessPool:
                    pools[pool].shutdown(kill_workers=True)
                    pools[pool] = new_pool()
                    if attempt < TRIES:
                        waiting.appendleft((k, attempt + 1))
                    else:
                        yield k, WorkerDied()
    finally:
        for one in pools:
            one.shutdown(kill_workers=True)


def _end_with(parent: int) -> None:
    """Let this process end soon after the one that started it: ``kill -9`` leaves nobody behind."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _on_dask(function: Callable, jobs: Sequence, workers: int, scheduler: str | None) -> Outcomes:
    from distributed import KilledWorker, as_completed

    with _dask_client(workers, scheduler) as client:
        futures = {
            client.submit(call_in_one_thread, function, job, pure=False): k
            for k, job in enumerate(jobs)
        }
        try:
            for future in as_completed(list(futures)):
                k = futures.pop(future)
                try:
                    outcome = future.result()
                except KilledWorker:
                    outcome = WorkerDied()
                future.release()
                yield k, outcome
        finally:
            client.cancel(list(futures))


@contextlib.contextmanager
def _dask_client(workers: int, scheduler: str | None) -> Iterator:
    import dask
    import distributed

    address = scheduler or dask.config.get("scheduler-address", None)
    if scheduler is None:
        connected = None
        with contextlib.suppress(ValueError):  # there is none
            connected = distributed.get_client()
        if connected is not None:
            yield connected
            return
    if address is None:
        size = {"n_workers": workers, "threads_per_worker": 1, "memory_limit": 0}
        options = {
            "distributed.scheduler.allowed-failures": TRIES - 1,
            # no job waits at a worker, where it would be counted among those that killed it
            "distributed.scheduler.worker-saturation": 1.0,
        }
        with (
            dask.config.set(options),
            distributed.Client(**size, dashboard_address=None) as client,
        ):
            yield client
        return
    try:
        client = distributed.Client(address, timeout=SECONDS)
    except (OSError, ValueError) as err:
        raise _unreachable("dask", address, err) from err
    with client:
        if not client.scheduler_info()["workers"]:
            warnings.warn(f"{address} has no workers yet; waiting for them", stacklevel=2)
        yield client


def _on_ray(function: Callable, jobs: Sequence, workers: int, scheduler: str | None) -> Outcomes:
    with _ray(workers, scheduler) as ray:
        died = (ray.exceptions.WorkerCrashedError, ray.exceptions.OutOfMemoryError)
        remote = ray.remote(call_in_one_thread).options(max_retries=TRIES - 1)
        left = {remote.remote(function, job): k for k, job in enumerate(jobs)}
        try:
            while left:
                for ref in ray.wait(list(left))[0]:
                    k = left.pop(ref)
                    try:
                        outcome = ray.get(ref)
                    except died:
                        outcome = WorkerDied()
                    yield k, outcome
        finally:
            for ref in left:
                ray.cancel(ref, force=True)


@contextlib.contextmanager
def _ray(workers: int, scheduler: str | None) -> Iterator:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is reported to anybody
    import ray

    if ray.is_initialized() and scheduler is None:
        yield ray
        return
    address = scheduler or os.environ.get("RAY_ADDRESS")
    how: dict = {"num_cpus": workers, "include_dashboard": False, "address": "local"}
    if address:
        _knock("ray", address)
        how = {"address": address}
    _start(ray, address, how)
    try:
        yield ray
    finally:
        ray.shutdown()


def _start(ray, address: str | None, how: dict) -> None:
    """Start or join a Ray cluster; again when a busy computer had not started it in 30 s."""
    for may_again in (True, False):
        try:
            ray.init(**how, log_to_driver=False, logging_level=logging.ERROR)
            return
        except (ConnectionError, RuntimeError, ValueError) as err:
            raise _unreachable("ray", address, err) from err
        except Exception as err:
            if type(err) is not Exception:  # Ray's own has no type when it waited in vain
                raise
            ray.shutdown()
            if not may_again:
                raise RuntimeError(
                    f"backend='ray' did not start here ({' '.join(str(err).split())}); end what "
                    "else is running, or take backend='loky'"
                ) from err


def _knock(backend: str, address: str) -> None:
    """Ray tries for minutes to reach a machine that is not there, and then ends the program."""
    import socket

    if address in ("auto", "local"):
        return
    host, _, port = address.rpartition("//")[2].rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=SECONDS).close()
    except (OSError, ValueError) as err:
        raise _unreachable(backend, address, err) from err


def _unreachable(backend: str, address: str | None, err: Exception) -> ValueError:
    why = " ".join(str(err).split()) or type(err).__name__
    token = ", and set RAY_AUTH_MODE=token if it asks for a token" if backend == "ray" else ""
    return ValueError(
        f"scheduler={address!r} cannot be reached ({why}); start the {backend} cluster first, "
        f"give the address that it prints, such as {EXAMPLES[backend]}{token}"
    )
