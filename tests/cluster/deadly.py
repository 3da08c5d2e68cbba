"""Jobs whose process is killed in the middle; on the path of all workers."""

import os
import signal
import sys
import time
from functools import partial
from pathlib import Path

from dancediff.backends import WorkerDied, run_jobs


def deadly(x: int, folder: Path) -> int:
    """Job 2 kills its process the first time, job 4 each time."""
    time.sleep(0.05)
    met = folder / f"met_{x}"
    if x == 4 or (x == 2 and not met.exists()):
        met.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return x


if __name__ == "__main__":
    backend, folder = sys.argv[1:]
    jobs = partial(deadly, folder=Path(folder))
    found = dict(run_jobs(jobs, range(8), workers=2, backend=backend))
    print([k if isinstance(v, WorkerDied) else v for k, v in sorted(found.items())])
    print([k for k, v in found.items() if isinstance(v, WorkerDied)])
