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
MADE = {  # sources whose dances the choreographer makes, and the options they take
    "choreograph": ("seconds", "seed"),
    "songs": ("seconds", "dances_per_song", "augment", "licence"),
}
SOURCES = (*READERS, *MADE)
REPEATS = 4  # dances of each group size to a song; a song takes as long to make as four dances


def source_jobs(name: str, src, **options) -> list[Job]:
    """Jobs of a data set or of songs in the folder ``src``; of "choreograph" ``src`` is how many.

    ``options`` are for what the choreographer dances: `choreograph_jobs` has "seconds" and "seed",
    `song_jobs` "seconds", "dances_per_song", "augment" and "licence". None stands for defaults.

    Raises: ValueError naming the argument, or what is missing in the folder.

    >>> len(source_jobs("choreograph", 12, seconds=8))
    12
    """
    if name not in SOURCES:
        raise ValueError(f"source={name!r} is not one of {', '.join(SOURCES)}")
    given = {key: value for key, value in options.items() if value is not None}
    for key, value in given.items():
        if key not in MADE.get(name, ()):
            raise ValueError(f"{key}={value!r} is no option of {name}; leave it out")
    if name == "choreograph":
        from dancediff.data.choreographed import choreograph_jobs

        try:
            num = int(str(src))
        except ValueError as err:
            raise ValueError(f"src={str(src)!r}: give the number of dances to make") from err
        return choreograph_jobs(num, repeats=REPEATS, varied=True, **given)
    if not Path(src).is_dir():
        raise ValueError(f"src={str(src)!r} is no folder; name the one that holds the data set")
    if name == "songs":
        from dancediff.data.recorded import song_jobs

        return song_jobs(src, **given)
    module, function = READERS[name]
    return getattr(importlib.import_module(module), function)(Path(src))


def prepare_source(
    name: str,
    src,
    out,
    *,
    workers: int = 1,
    backend: str = "loky",
    scheduler: str | None = None,
    progress: bool = True,
    **options,
) -> Summary:
    """Prepare a data set: its takes and, for silent motion capture, music and composed groups.

    ``options`` are those of `source_jobs`.

    Raises: ValueError naming the argument; OSError when ``out`` cannot be written.
    """
    how: dict = {"workers": workers, "backend": backend, "scheduler": scheduler}
    how["progress"] = progress
    jobs = source_jobs(name, src, **options)
    if name != "cmu":
        return prepare(jobs, out, **how)
    from dancediff.data.composed import composed_jobs
    from dancediff.data.soundtrack import soundtrack_jobs

    real = prepare(soundtrack_jobs(jobs), out, **how)
    more = composed_jobs(out) if real.prepared else []
    return real.then(prepare(more, out, **how)) if more else real
