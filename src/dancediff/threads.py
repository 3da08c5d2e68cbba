"""Threads that compute beside a program, and that its end waits for."""

import atexit
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Result = TypeVar("Result")


def begun_beside(work: Callable[[], Result]) -> Callable[[], Result]:
    """Begin work in a second thread; what is returned waits for its result.

    While a program ends, no thread can be started any more: then the work is done at once, here.

    >>> begun_beside(lambda: 2 + 3)()
    5
    """
    pool = ThreadPoolExecutor(1)
    try:
        result = pool.submit(work)
    except RuntimeError:  # "cannot schedule new futures after interpreter shutdown"
        result = Future()
        result.set_result(work())
    pool.shutdown(wait=False)
    return result.result


def _nothing() -> None:
    """What a thread is told that ends by itself."""


class Worker(threading.Thread):
    """A thread that is told to stop, and waited for, when the program ends.

    Python cuts off the threads that still run at its end; one that is inside a C++ library then
    takes the whole process down ("terminate called without an active exception"). A thread that
    Python waits for would keep a program alive whose user has left. This one does neither.

    - ``stop``: called once when the program ends, unless the thread is over by then; what it does
      must make ``target`` return soon. Leave it out where ``target`` ends soon by itself.

    >>> asked = threading.Event()
    >>> worker = Worker(asked.wait, stop=asked.set).begin()
    >>> worker.end(), worker.is_alive()
    (None, False)
    """

    def __init__(self, target: Callable, *values, stop: Callable[[], object] = _nothing):
        """Nothing runs yet; ``values`` are handed to ``target``."""
        super().__init__(daemon=True)
        self._work, self._values, self._stop_it = target, values, stop

    def begin(self) -> "Worker":
        """Start it; returns the worker."""
        # what is registered last is called first: before folders that it writes to are removed
        atexit.register(self.end)
        self.start()
        return self

    def run(self) -> None:
        """In the thread."""
        try:
            self._work(*self._values)
        finally:
            atexit.unregister(self.end)

    def end(self) -> None:
        """Stop it, and wait until it has ended."""
        self._stop_it()
        self.join()
