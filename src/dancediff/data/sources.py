"""From the name of a data set to prepared takes: what ``dancediff prepare`` runs."""

import importlib
from pathlib import Path

from dancediff.data.prepare import prepare
from dancediff.data.summary import Summary
from dancediff.data.take import Job

READERS = {
    "aioz": ("dancediff.data.aioz", "aioz_jobs"),
    "finedance": ("dancediff.data.finedance", "finedance_jobs"),
    "aistpp": ("dancediff.data.aistpp", "aistpp_jobs"),
    "cmu": ("dancediff.data.cmu", "cmu_jobs"),
}
SOURCES = (*READERS, "choreograph")
REPEATS = 4  # dances of each group size to a song; a song takes as long to make as four dances


def source_jobs(name: str, src, *, seconds: float = 10.0, seed: int = 0) -> list[Job]:
    """Jobs of a data set in the folder ``src``; of "choreograph" ``src`` is how many takes.

    ``seconds`` and ``seed`` (of the first song) are for "choreograph" only.

    Raises: ValueError naming the argument, or what is missing in the folder.

    >>> len(source_jobs("choreograph", 12))
    12
    """
    if name not in SOURCES:
        raise ValueError(f"source={name!r} is not one of {', '.join(SOURCES)}")
    if name == "choreograph":
        from dancediff.data.choreographed import choreograph_jobs

        try:
            num = int(str(src))
        except ValueError as err:
            raise ValueError(f"src={str(src)!r}: give the number of dances to make") from err
        return choreograph_jobs(num, seconds=seconds, seed=seed, repeats=REPEATS)
    if not Path(src).is_dir():
        raise ValueError(f"src={str(src)!r} is no folder; name the one that holds the data set")
    module, function = READERS[name]
    return getattr(importlib.import_module(module), function)(Path(src))


def prepare_source(
    name: str,
    src,
    out,
    *,
    workers: int = 1,
    backend: str = "loky",
    seconds: float = 10.0,
    seed: int = 0,
    progress: bool = True,
) -> Summary:
    """Prepare a data set: its takes and, for silent motion capture, music and composed groups.

    Raises: ValueError naming the argument; OSError when ``out`` cannot be written.
    """
    options: dict = {"workers": workers, "backend": backend, "progress": progress}
    jobs = source_jobs(name, src, seconds=seconds, seed=seed)
    if name != "cmu":
        return prepare(jobs, out, **options)
    from dancediff.data.composed import composed_jobs
    from dancediff.data.soundtrack import soundtrack_jobs

    real = prepare(soundtrack_jobs(jobs), out, **options)
    more = composed_jobs(out) if real.prepared else []
    return real.then(prepare(more, out, **options)) if more else real
