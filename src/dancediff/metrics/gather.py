"""Many dances, measured one after the other or by several processes.

Only what `measure` leaves of each is kept, some kilobytes, so memory does not grow with the length
of the dances, and hardly with their number.
"""

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import torch

from dancediff.data.prepared import PreparedData
from dancediff.data.take import DanceTake
from dancediff.metrics.measure import Measured, Source, measure
from dancediff.motion.motion import Motion


def find_dances(sources) -> list[Source]:
    """Every dance that is meant, none twice: files, and what lies in folders.

    A source is an .npz file, a folder of them (folders in it included), a prepared folder, or a
    `Motion` or `DanceTake`, which stays as it is.

    Raises: ValueError naming a path that does not exist, is no .npz, or a folder without any.

    >>> find_dances(["nowhere.npz"])
    Traceback (most recent call last):
        ...
    ValueError: 'nowhere.npz' does not exist; give .npz dances, folders of them or a prepared folder
    """
    one = isinstance(sources, str | Path | Motion | DanceTake)
    found: dict = {}
    for source in [sources] if one else sources:
        if isinstance(source, Motion | DanceTake):
            found[id(source)] = source
        else:
            found |= {path.resolve(): path for path in _files(Path(source))}
    if not found:
        raise ValueError("there are no dances to evaluate: the list is empty")
    return list(found.values())


def _files(path: Path) -> Iterator[Path]:
    if not path.exists():
        what = "give .npz dances, folders of them or a prepared folder"
        raise ValueError(f"{str(path)!r} does not exist; {what}")
    if not path.is_dir():
        if path.suffix != ".npz":
            raise ValueError(f"{str(path)!r} is no .npz; give dances that Motion.save wrote")
        if not path.is_file():  # a pipe would be waited for without end
            raise ValueError(f"{str(path)!r} is no regular file; save the dance to one first")
        return iter([path])
    if (path / "index.json").is_file():
        files = [path / entry.file for entry in PreparedData(path)]
    else:
        files = sorted(path.rglob("*.npz"))
        # what is being written lies under names with a dot
        files = [f for f in files if not any(p.startswith(".") for p in f.relative_to(path).parts)]
    if not files:
        raise ValueError(f"{str(path)!r} holds no .npz dance; name a folder that does")
    return iter(files)


def measure_all(
    sources: list[Source],
    beats: Iterable,
    label: str,
    *,
    window: int | None = None,
    workers: int = 1,
    progress: bool = False,
) -> tuple[list[Measured], dict[str, str]]:
    """What `measure` leaves of every dance, and why some could not be read.

    ``beats`` has those of each dance, or None. The results do not depend on ``workers``.

    Raises: ValueError when not one dance can be read; ``label`` says of what.
    """
    from tqdm.auto import tqdm

    found, skipped = [], {}
    jobs = [
        (source, f"dance {k}", times, window)
        for k, (source, times) in enumerate(zip(sources, beats, strict=False))
    ]
    outcomes = _run(jobs, min(workers, len(jobs)))
    bar = tqdm(outcomes, total=len(jobs), desc=label, unit="dance", disable=not progress)
    for outcome in bar:
        if isinstance(outcome, Measured):
            found.append(outcome)
        else:
            skipped |= outcome
    if not found:
        name, why = next(iter(skipped.items()))
        raise ValueError(f"none of the {len(skipped)} {label} can be read; {name}: {why}")
    return found, skipped


def _run(jobs: list, workers: int) -> Iterator[Measured | dict[str, str]]:
    if workers == 1:
        with _one_thread():
            yield from (_job(*job) for job in jobs)
        return
    import joblib

    with joblib.parallel_config("loky", inner_max_num_threads=1):
        parallel = joblib.Parallel(n_jobs=workers, return_as="generator")
        yield from parallel(joblib.delayed(_job)(*job) for job in jobs)


@contextlib.contextmanager
def _one_thread():
    """Small tensors gain nothing from threads, and sums over several of them round differently."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _job(source, name: str, beats, window: int | None) -> Measured | dict[str, str]:
    with _one_thread():
        try:
            return measure(source, name=name, beats=beats, window=window)
        except (ValueError, OSError, RecursionError) as err:  # the last: JSON in JSON in JSON ...
            return {str(source) if isinstance(source, Path) else name: " ".join(str(err).split())}
