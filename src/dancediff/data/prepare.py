r"""`prepare`: run many jobs, write one take each, skip what is bad, and say so.

Read first: `dancediff.data.take`.

Each take is one file that tells how it was made (``made_by``: function, arguments and our code), so
a run that was stopped goes on where it was, and a take is made anew when its recipe has changed.
The index is written last, from the files, sorted by name: the folder's bytes do not depend on the
number of workers, nor on how often the run was stopped.
"""

import contextlib
import json
import shutil
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import is_dataclass
from functools import lru_cache, partial
from hashlib import file_digest, sha256
from pathlib import Path

from tqdm.auto import tqdm

from dancediff.atomic import atomic_write, is_full, sweep
from dancediff.axes import FPS
from dancediff.backends import WorkerDied, check_backend, run_jobs
from dancediff.data.cache import code_digest, use_cache
from dancediff.data.prepared import FOLDERS, FORMAT, NAME, PACKING, read_index
from dancediff.data.summary import Summary
from dancediff.data.take import Job
from dancediff.data.take_file import SCRATCH, describe, read_row, write_take

MADE, KEPT = "made", "kept"


def prepare(
    jobs: list[Job],
    out,
    *,
    workers: int = 1,
    backend: str = "loky",
    scheduler: str | None = None,
    progress: bool = True,
    replaces: Callable[[dict], bool] | None = None,
) -> Summary:
    """Make the takes of ``jobs`` that the folder ``out`` lacks, and write its index.

    What the folder already holds from other jobs stays in it, but for takes of whose rows in the
    index ``replaces`` says yes: they leave it. One run at a time may write to a folder.
    ``workers``, ``backend``, ``scheduler``: see `dancediff.backends.run_jobs`; all machines of a
    cluster must see the folder under the same path.

    A job that raises is skipped, and reported in the summary and the index; the next run tries it
    again. Takes are written by the workers, so memory does not grow with their number.

    Raises: ValueError naming the argument; OSError when ``out`` cannot be written.
    """
    jobs, out = list(jobs), Path(out).absolute()
    _check(jobs)
    check_backend(workers, backend, scheduler)
    for folder in FOLDERS:
        (out / folder).mkdir(parents=True, exist_ok=True)
    for left in [*out.glob(f"{SCRATCH}*"), *out.glob(f"cache/{PACKING}*")]:  # of killed runs
        shutil.rmtree(left)
    sweep(out / "cache")
    summary = Summary(out)
    bar = partial(tqdm, total=len(jobs), desc="preparing", unit="take", disable=not progress)
    make = partial(run_job, out=out)
    outcomes = run_jobs(make, jobs, workers=workers, backend=backend, scheduler=scheduler)
    for k, outcome in bar(outcomes):
        if isinstance(outcome, WorkerDied):
            summary.skipped[jobs[k].name] = str(outcome)
        elif outcome == MADE:
            summary.made += 1
        elif outcome == KEPT:
            summary.kept += 1
        else:
            summary.skipped[jobs[k].name] = outcome.removeprefix("skipped: ")
    names = {job.name for job in jobs}
    old = {}
    with contextlib.suppress(ValueError):  # there is none, or it is damaged
        old = read_index(out)
    summary.dropped = _replaced(old, names, replaces)
    _write_index(out, names, old, summary)
    current = {name.lower() for name in names}  # where capitals do not count, one file has both
    for name in summary.dropped:  # only now: when the index cannot be written, all stays as it was
        path = _find(out, name)
        if path is not None and name.lower() not in current:
            path.unlink()
    return summary


def _replaced(old: dict, names: set[str], replaces: Callable[[dict], bool] | None) -> list[str]:
    """Names of takes that leave; what is no name leads to files that are not ours."""
    if replaces is None:
        return []
    gone = {row["name"] for row in old.get("takes", []) if replaces(row)} - names
    return sorted(name for name in gone if NAME.fullmatch(name))


def _check(jobs: list[Job]) -> None:
    if not jobs:
        raise ValueError("there are no takes to prepare: the list of jobs is empty")
    for name, count in Counter(job.name for job in jobs).items():
        if count > 1:
            raise ValueError(f"{count} takes are called {name!r}; give each its own name")
        if not NAME.fullmatch(name):
            raise ValueError(f"take {name!r}: use letters, digits and _ . + - in names")


def run_job(job: Job, out: Path) -> str:
    """Make one take and write it, unless it is there: "made", "kept" or "skipped: " and why."""
    path = _find(out, job.name)
    try:
        made_by = recipe(job)  # reads the files that are arguments
        if path is not None and _made_by(path) == made_by:
            return KEPT
        with use_cache(out / "cache" / "features"):
            take = job.make()
        if take.name != job.name:
            raise ValueError(f"it calls itself {take.name!r}")
        if take.motion.fps != FPS:
            raise ValueError(f"it has {take.motion.fps} frames a second, not {FPS}")
        if missing := [part for part in ("source", "licence", "group") if not getattr(take, part)]:
            raise ValueError(f"it does not tell its {' and '.join(missing)}")
        describe(take)
    except Exception as err:  # one odd file must not end a run over thousands
        if is_full(err):
            raise
        if path is not None and not _unreachable(err):
            path.unlink()  # the take has become bad: no old version shall pass for it
        kind = "" if isinstance(err, ValueError) else f"{type(err).__name__}: "
        return f"skipped: {kind}{' '.join(str(err).split())}"
    folder = FOLDERS[take.kind == "composed"]
    new = write_take(out / folder / f"{job.name}.npz", take, made_by)
    if path not in (None, new):  # the old one was of the other kind
        path.unlink()
    return MADE


def _made_by(path: Path) -> str | None:
    with contextlib.suppress(ValueError):  # damaged
        return read_row(path)["made_by"]
    return None


def _unreachable(err: BaseException | None) -> bool:
    """Was it the disk that failed? Then the source may be back the next time, as it was."""
    while err is not None:
        if isinstance(err, OSError) and err.errno is not None:
            return True
        err = err.__cause__ or err.__context__
    return False


def recipe(job: Job) -> str:
    """A hash of what a take follows from: function, arguments and our own code.

    Of files that are arguments name and content count, so a data set may be moved; of functions
    that are not ours the file they stand in. Files that a job finds in a folder do not count. To
    make a take anew, delete it.
    """
    text = f"{code_digest()} {_words(job.make)}"
    return sha256(text.encode()).hexdigest()[:16]


def _words(x) -> str:
    if isinstance(x, partial):
        return f"{_words(x.func)}{_words(x.args)}{_words(x.keywords)}"
    if isinstance(x, Path):
        return f"{x.name}:{_content(x) if x.is_file() else ''}"
    if is_dataclass(x) and not isinstance(x, type):
        x = vars(x)
    if isinstance(x, dict):
        x = [(key, x[key]) for key in sorted(x)]
    if isinstance(x, list | tuple):
        return f"({','.join(map(_words, x))})"
    if callable(x):
        own = not x.__module__.startswith("dancediff.")
        file = getattr(sys.modules.get(x.__module__), "__file__", None)
        code = _content(Path(file)) if own and file is not None else ""
        return f"{x.__module__}.{getattr(x, '__qualname__', x)}{code}"
    return repr(x)


def _content(path: Path) -> str:
    stat = path.stat()
    return _digest(path, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=4096)
def _digest(path: Path, _size: int, _changed: int) -> str:
    with path.open("rb") as file:  # a song of several takes is read once
        return file_digest(file, "sha256").hexdigest()[:16]


def _find(out: Path, name: str) -> Path | None:
    paths = (out / folder / f"{name}.npz" for folder in FOLDERS)
    return next((path for path in paths if path.exists()), None)


def _write_index(out: Path, names: set[str], old: dict, summary: Summary) -> None:
    """Write index.json line by line from the files: of these jobs, and of the index before."""
    wanted = names | {row["name"] for row in old.get("takes", [])}
    wanted -= {*summary.skipped, *summary.dropped}
    skipped = {row["name"]: row["reason"] for row in old.get("skipped", [])}
    skipped = {name: why for name, why in skipped.items() if name not in wanted} | summary.skipped
    with atomic_write(out / "index.json") as part, part.open("w", encoding="utf-8") as file:
        file.write(f'{{\n"format": "{FORMAT}",\n"fps": {FPS},\n"takes": [')
        comma = "\n"
        for name in sorted(wanted):
            if (path := _find(out, name)) is None:
                continue  # somebody deleted it
            try:
                row = read_row(path)
            except ValueError as err:  # of an earlier run; it must not end every later one
                skipped[name] = summary.skipped[name] = str(err)
                continue
            summary.add(row)
            row["file"] = path.relative_to(out).as_posix()
            file.write(comma + json.dumps(row, sort_keys=True))
            comma = ",\n"
        rows = [{"name": name, "reason": skipped[name]} for name in sorted(skipped)]
        file.write(f'\n],\n"skipped": {json.dumps(rows, indent=0)}\n}}\n')
