"""Calls in several processes, as benchmarks dance: in order, with a bar, each in one thread."""

from collections.abc import Callable, Iterable

import joblib
from tqdm.auto import tqdm

from dancediff.backends import one_thread


def in_processes(calls: Iterable, workers: int, *, label: str = "dancing") -> list:
    """What `joblib.delayed` calls return, in their order.

    >>> in_processes([joblib.delayed(pow)(2, k) for k in (3, 5)], workers=1)
    [8, 32]
    """
    todo = [joblib.delayed(_in_one_thread)(*call) for call in calls]
    run = joblib.Parallel(max(1, min(workers, len(todo))), return_as="generator")
    return list(tqdm(run(todo), total=len(todo), desc=label))


def _in_one_thread(function: Callable, args: tuple, options: dict):
    with one_thread():
        return function(*args, **options)
