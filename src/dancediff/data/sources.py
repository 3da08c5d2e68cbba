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
SPLIT = {"finedance": ("split",)}  # of those with two ways to split
MADE = {  # sources whose dances the choreographer makes, and the options they take
    "choreograph": ("seconds", "seed"),
    "songs": ("seconds", "dances_per_song", "augment", "licence"),
}
FOLDER = ("group", "fps", "up", "unit", "licence")  # options of a folder of anybody's motion
SOURCES = (*READERS, *MADE, "folder")
REPEATS = 4  # dances of each group size to a song; a song takes as long to make as four dances


def source_jobs(name: str, src, **options) -> list[Job]:
    """Jobs of a data set or of songs in the folder ``src``; of "choreograph" ``src`` is how many.

    ``options`` are for what the choreographer dances: `choreograph_jobs` has "seconds" and "seed",
    `song_jobs` "seconds", "dances_per_song", "augment" and "licence"; "split" is for
    `finedance_jobs`. None stands for defaults.

    A folder of anybody's motion has more to it than jobs: see `prepare_source`.

    Raises: ValueError naming the argument, or what is missing in the folder.

    >>> len(source_jobs("choreograph", 12, seconds=8))
    12
    """
    known = (*READERS, *MADE)
    if name not in known:
        raise ValueError(f"source={name!r} is not one of {', '.join(known)}")
    given = _options(name, MADE.get(name, SPLIT.get(name, ())), options)
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
    return getattr(importlib.import_module(module), function)(Path(src), **given)


def _options(name: str, allowed: tuple[str, ...], options: dict) -> dict:
    """The options that are given, of which all must be allowed."""
    given = {key: value for key, value in options.items() if value is not None}
    for key, value in given.items():
        if key not in allowed:
            raise ValueError(f"{key}={value!r} is no option of {name}; leave it out")
    return given


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

    ``options`` are those of `source_jobs`; of "folder", group, licence, fps, up and unit of
    `prepare_folder`, and ``draw``.

    Raises: ValueError naming the argument; OSError when ``out`` cannot be written.
    """
    how: dict = {"workers": workers, "backend": backend, "scheduler": scheduler}
    how["progress"] = progress
    draw = options.pop("draw", None)
    if name == "folder":
        return _prepare_folder(src, out, options, draw=draw, **how)
    jobs = source_jobs(name, src, **options)
    if name != "cmu":
        return prepare(jobs, out, **how)
    from dancediff.data.composed import composed_jobs
    from dancediff.data.soundtrack import soundtrack_jobs

    real = prepare(soundtrack_jobs(jobs), out, **how)
    more = composed_jobs(out) if real.prepared else []
    return real.then(prepare(more, out, **how)) if more else real


def _prepare_folder(src, out, options: dict, **how) -> Summary:
    from dancediff.data.folder.posture import Given
    from dancediff.data.folder.prepare import prepare_folder

    given = _options("folder", FOLDER, options)
    about = Given(**{key: given.pop(key) for key in ("fps", "up", "unit") if key in given})
    return prepare_folder(src, out, given=about, **given, **how)
