"""Many dances, each measured by one of several processes; what is kept is not measured again.

Read first: `dancediff.metrics.measure` · `dancediff.metrics.kept`.
"""

import contextlib
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from dancediff.backends import run_jobs
from dancediff.metrics.dances import Source, told_apart
from dancediff.metrics.kept import keep, kept_path, read_kept
from dancediff.metrics.measure import Measured, measure


def measure_all(
    sources: list[Source],
    beats: Iterable,
    label: str,
    *,
    window: int | None = None,
    metrics: tuple[str, ...] = (),
    kept: Path | None = None,
    progress: bool = False,
    **how,
) -> tuple[list[Measured], dict[str, str]]:
    """What `measure` returns for every dance, and why some could not be read.

    ``beats`` has those of each dance, or None. ``kept``: a folder of measurements, see
    `dancediff.metrics.kept`; what is there is not made again. ``how``: who computes, see
    `dancediff.backends.run_jobs`; the results do not depend on it.

    Raises: ValueError when there is no dance, or not one can be read; ``label`` says of what.
    """
    from tqdm.auto import tqdm

    if not sources:
        raise ValueError(f"there are no {label} to measure: the list is empty")
    jobs = [
        partial(
            _measure_or_reason,
            source.absolute() if isinstance(source, Path) else source,
            f"dance {k}",
            times,
            window,
            metrics,
            None if kept is None else Path(kept).absolute(),
        )
        for k, (source, times) in enumerate(zip(sources, beats, strict=False))
    ]
    outcomes = run_jobs(_called, jobs, **how)
    bar = partial(tqdm, total=len(jobs), desc=label, unit="dance", disable=not progress)
    measured = dict(bar(outcomes))
    found: list[Measured] = []
    skipped: dict[str, str] = {}
    for k, source in enumerate(sources):
        if isinstance(measured[k], Measured):
            found.append(measured[k])
        else:
            skipped[str(source) if isinstance(source, Path) else f"dance {k}"] = str(measured[k])
    if not found:
        name, why = next(iter(skipped.items()))
        raise ValueError(f"none of the {len(skipped)} {label} can be read; {name}: {why}")
    read = [k for k in range(len(sources)) if isinstance(measured[k], Measured)]
    of_files = [(measured[k], path) for k in read if isinstance(path := sources[k], Path)]
    names = told_apart([one.name for one, _ in of_files], [path for _, path in of_files])
    for (one, _), name in zip(of_files, names, strict=True):
        one.name = name  # what is kept of it has its own name, whatever it is measured beside
    return found, skipped


def _called(job: Callable):
    return job()


def _measure_or_reason(
    source, name: str, beats, window: int | None, metrics: tuple[str, ...], folder: Path | None
) -> Measured | str:
    options = {"name": name, "beats": beats, "window": window, "metrics": metrics}
    try:
        if folder is None or not isinstance(source, Path):
            return measure(source, **options)
        path = kept_path(folder, source, beats, window, metrics=metrics)
        found = read_kept(path)
        if found is None:
            found = measure(source, **options)
            with contextlib.suppress(OSError):  # a full disk is not this dance's fault
                keep(path, found)
        return found
    except (ValueError, OSError, RecursionError) as err:  # the last: JSON in JSON in JSON ...
        return " ".join(str(err).split())
