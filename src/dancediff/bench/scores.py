"""What dances of held-out windows score, danced by several processes and kept on disk.

Read first: `dancediff.bench.held_out` · `dancediff.metrics.rows`.
"""

import itertools
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

import joblib

from dancediff import hub
from dancediff.bench.held_out import SEGMENT, Window
from dancediff.bench.in_processes import in_processes
from dancediff.generation.pipeline import Pipeline
from dancediff.metrics.dances import find_dances
from dancediff.metrics.measure import Measured
from dancediff.metrics.measure_all import measure_all
from dancediff.metrics.rows import table_rows
from dancediff.motion.motion import Motion

Dance = Callable[[Pipeline, Window, int], Motion]  # a model, a window and a seed


def danced(
    folder: Path, model: Path, some: Sequence[Window], dance: Dance, *, workers: int = 1
) -> list[Path]:
    """The dances of some windows in a folder, made where they are not there; window k has seed k.

    ``dance`` goes to other processes: a function of a module, or a `functools.partial` of one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{window.name}.npz" for window in some]
    jobs = [
        joblib.delayed(_dance_to)(path, model, window, seed, dance)
        for seed, (path, window) in enumerate(zip(files, some, strict=True))
        if not path.exists()
    ]
    if jobs:
        in_processes(jobs, workers, label=f"dancing {folder.name}")
    return files


def _dance_to(path: Path, model: Path, window: Window, seed: int, dance: Dance) -> None:
    motion = dance(loaded(model), window, seed)
    motion.meta["kind"] = "generated"
    motion.save(path)


@lru_cache(maxsize=1)
def loaded(folder: str | Path) -> Pipeline:
    """A model by name or folder, which a process reads once as long as no other is asked for."""
    return hub.load(folder)


def scores_of(
    dances: Sequence[Path | Motion],
    some: Sequence[Window],
    reference: list[Measured],
    *,
    workers: int = 1,
) -> dict[str, list]:
    """Every metric of dances of some windows: value, low and high end of its interval."""
    beats = [window.beats for window in some]
    measured, _ = measure_all(list(dances), beats, "dances", window=SEGMENT, workers=workers)
    return {row.name: [row.value, row.low, row.high] for row in table_rows(measured, reference)}


def reference_of(folder: Path, *, workers: int = 1) -> list[Measured]:
    """What dances are compared with: all takes of a prepared folder, measured."""
    sources, none = find_dances([folder]), itertools.repeat(None)
    return measure_all(sources, none, "reference", window=SEGMENT, workers=workers)[0]
