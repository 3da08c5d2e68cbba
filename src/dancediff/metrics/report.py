"""`evaluate` and `evaluate_dances`: every metric of some dances as one table, with intervals.

Read first: notebook 13 · docs/metrics.md and its pages.
"""

import itertools
import json
import math
import operator
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from numbers import Real
from os import PathLike
from pathlib import Path

import numpy as np

from dancediff.atomic import write_text
from dancediff.data.take import DanceTake
from dancediff.metrics.dances import find_dances
from dancediff.metrics.drift import Drift, mean_drift
from dancediff.metrics.inputs import ACCELERATION
from dancediff.metrics.measure import Measured
from dancediff.metrics.measure_all import measure_all
from dancediff.metrics.rows import DRAWS, LEVEL, METRICS, Row, table_rows
from dancediff.motion.motion import Motion
from dancediff.music.song import Music, as_song
from dancediff.own import own_function


@dataclass
class Report:
    """The rows, and what they were computed from; ``str`` is the table.

    ``dances`` and ``reference`` count and name the dances by kind, ``skipped`` has a reason for
    each that could not be read, ``notes`` what a reader must know. ``drift`` is the mean over
    dances of 5 s and more, None where there is none.
    """

    rows: list[Row]
    dances: dict
    reference: dict | None = None
    skipped: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    drift: Drift | None = None

    def __getitem__(self, name: str) -> Row:
        """The row of a metric.

        Raises: KeyError naming the metrics that there are.
        """
        for row in self.rows:
            if row.name == name:
                return row
        raise KeyError(f"{name!r} is not one of {', '.join(row.name for row in self.rows)}")

    def __str__(self) -> str:
        return _as_text(self)

    @property
    def is_empty(self) -> bool:
        """Whether no metric has a value."""
        return all(math.isnan(row.value) for row in self.rows)

    def facts(self) -> dict:
        """The report as plain JSON; nan is None there, and its reason stands beside it."""
        facts = asdict(self)
        for row in facts["rows"]:
            row |= {
                k: None if isinstance(v, float) and math.isnan(v) else v for k, v in row.items()
            }
        drift = None if self.drift is None else self.drift.facts()
        return facts | {"drift": drift, "level": LEVEL, "draws": DRAWS}

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(self.facts(), allow_nan=False)

    def save(self, path) -> Path:
        """Write the JSON; the file appears whole or not at all."""
        path = Path(path)
        write_text(path, self.to_json() + "\n")
        return path


ARROWS = {"down": "↓", "up": "↑", "reference": "as the reference"}
NAMED = 3  # dances of a kind that are named in the text; the JSON names all
KIND_WORDS = {
    "composed": "composed of real solos and duets, so they tell nothing about real groups",
    "synthetic": "synthetic, made by a program without any real motion",
}


def _as_text(report: Report) -> str:
    """What was measured, one line for each metric, and the reasons below."""
    lines = _header("", report.dances)
    if report.reference is not None:
        lines += _header("reference: ", report.reference)
    lines += [f"left out, {name}: {why}" for name, why in report.skipped.items()]
    lines += report.notes
    if report.dances["count"] > 1:
        lines.append(
            f"intervals: bootstrap, {DRAWS} draws of whole dances; the reference is not drawn again"
        )
    notes = list(dict.fromkeys(row.reason for row in report.rows if row.reason))
    table: list[tuple[str, ...]] = [
        ("metric", "value", f"{LEVEL:.0%} interval", "n", "samples", "unit", "better")
    ]
    table += [_cells(row) for row in report.rows]
    if report.reference is not None:
        own = ["reference", *(_number(row.reference) for row in report.rows)]
        table = [(*cells, number) for cells, number in zip(table, own, strict=True)]
    marks = ["", *(f"({notes.index(r.reason) + 1})" if r.reason else "" for r in report.rows)]
    table = [(*cells, mark) for cells, mark in zip(table, marks, strict=True)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines.append("")
    for cells in table:
        padded = [cell.ljust(width) for cell, width in zip(cells, widths, strict=True)]
        lines.append("  ".join(padded).rstrip())
    lines += ["", *(f"({k}) {note}" for k, note in enumerate(notes, 1))] if notes else []
    return "\n".join(lines)


def _header(what: str, about: dict) -> list[str]:
    dancers, frames, fps = (_span(about[key]) for key in ("dancers", "frames", "fps"))
    size = f"{dancers} {'dancer' if dancers == '1' else 'dancers'}, {frames} frames at {fps} fps"
    lines = [f"{what}{_plural(about['count'], 'dance')}: {size}"]
    for kind, count in about["kinds"].items():
        names = about["names"][kind]
        more = f" and {count - NAMED} more" if count > NAMED else ""
        lines.append(f"    {count} {KIND_WORDS.get(kind, kind)}: {', '.join(names[:NAMED])}{more}")
    return lines


def _cells(row: Row) -> tuple[str, ...]:
    interval = "" if row.low is None else f"{_number(row.low)} … {_number(row.high)}"
    return (row.name, _number(row.value), interval, str(row.n), str(row.samples), row.unit,
            ARROWS[row.arrow])  # fmt: skip


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _span(values: list) -> str:
    """The only value, or the smallest and the largest."""
    return f"{values[0]:g}" if len(values) == 1 else f"{values[0]:g}–{values[-1]:g}"


def _plural(count: int, word: str) -> str:
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def evaluate(dance, song=None) -> Report:
    """Every metric of one dance that needs no reference set.

    ``dance`` is a `Motion`, a `DanceTake` or a file; ``song`` a `Music`, a sound file, or times of
    beats in seconds. One dance has no interval.

    Raises: ValueError as `evaluate_dances`, or for a list of dances and what is no dance.

    >>> from dancediff.data.choreographer import choreograph
    >>> beats = np.arange(0.5, 4, 0.5)
    >>> report = evaluate(choreograph(beats, dancers=2, seed=0)[0], beats)
    >>> report["BAS"].value > 0.5, report["TIF"].value, report["FSR"].value < 0.1
    (True, 0.0, True)
    """
    if isinstance(dance, list | tuple):
        raise ValueError(
            f"dance is a {type(dance).__name__} of {len(dance)}; give one, or call "
            "dancediff.metrics.report.evaluate_dances for many"
        )
    if not isinstance(dance, str | PathLike | Motion | DanceTake):
        raise ValueError(
            f"dance is a {type(dance).__name__}; give a Motion, a DanceTake or the path of a dance"
        )
    report = evaluate_dances([dance], song=song)
    names = {metric.name for metric in METRICS if metric.compare}
    report.rows = [row for row in report.rows if row.name not in names]
    return report


def evaluate_dances(
    dances,
    *,
    reference=None,
    song=None,
    window: int | None = None,
    metrics: Sequence[str] = (),
    seed: int = 0,
    progress: bool = False,
    **how,
) -> Report:
    r"""Every metric of many dances, with a 95 % bootstrap interval over dances.

    - ``dances``, ``reference``: what `find_dances` takes: files, folders, prepared folders,
      `Motion`, `DanceTake`, or a list of these. Without a reference FID, Div and GMR are nan.
    - ``song``: where the beats of dances that bring none are taken from: a `Music`, a sound file,
      or times in seconds; or a list of these, one for each dance. Not for the reference.
    - ``window``: cut every dance (the reference's too) into pieces of so many frames. Values are
      then over windows. The bootstrap still draws whole dances: windows of one dance are alike,
      and drawing them singly would make the intervals too narrow.
    - ``metrics``: functions of your own as "module:function", each called with the joints of a
      dance (n, f, j, 3) and ``fps=``; the mean over dances stands below the others.
    - ``how``: ``workers``, ``backend`` and ``scheduler`` of `dancediff.backends.run_jobs`, and
      ``kept``, a folder where measurements are kept so that a stopped evaluation goes on; the
      numbers do not depend on them.

    The reference is taken as it is, so intervals do not tell how it would vary.
    A dance that cannot be read is skipped and named; a metric that cannot be computed is nan, with
    the reason.

    Raises: ValueError naming the argument, or when not one dance can be read.
    """
    sources = find_dances(dances)
    others = None if reference is None else find_dances(reference)
    _check_window(window)
    for name in metrics:
        own_function(name, "metric")
    how |= {"window": window, "progress": progress, "metrics": tuple(metrics)}
    measured, skipped = measure_all(sources, _beats(song, len(sources)), "dances", **how)
    real: list[Measured] | None = None
    notes = [] if window is None else [f"dances are cut into windows of {window} frames"]
    if others is not None:
        real, lost = measure_all(others, itertools.repeat(None), "reference", **how)
        skipped |= {f"reference {name}": why for name, why in lost.items()}
        if both := len(_identities(sources) & _identities(others)):
            notes.append(f"{both} dances are in the reference too: distances to it are too small")
    drifts = [one.drift for one in measured if one.drift is not None]
    return Report(
        rows=list(table_rows(measured, real, metrics=tuple(metrics), seed=seed)),
        dances=_about(measured),
        reference=None if real is None else _about(real),
        skipped=skipped,
        notes=notes,
        drift=mean_drift(drifts) if drifts else None,
    )


def _check_window(window) -> None:
    """Raises: ValueError unless it is None, or whole frames and not too few."""
    if window is None:
        return
    if not hasattr(window, "__index__"):
        raise ValueError(f"window={window!r} must be an integer, a number of frames, or None")
    if operator.index(window) < ACCELERATION:
        raise ValueError(f"window={window} must be at least {ACCELERATION} frames")


def _beats(song, count: int) -> list:
    """Beats for each dance, or None."""
    many = isinstance(song, list | tuple) and not all(isinstance(s, Real) for s in song)
    if not many:
        return [_beats_of(song)] * count
    if len(song) != count:
        raise ValueError(
            f"song has {len(song)} songs for {count} dances; pass one for each, or one"
        )
    return [_beats_of(one) for one in song]


def _beats_of(song) -> np.ndarray | None:
    if song is None:
        return None
    if isinstance(song, Music | str | PathLike):
        song = as_song(song).beats()
    return np.asarray(song, dtype=np.float64)


def _identities(sources) -> set:
    return {source.resolve() if isinstance(source, Path) else id(source) for source in sources}


def _about(found: list[Measured]) -> dict:
    """What a table says about its dances."""
    about: dict = {
        "count": len(found),
        "windows": sum(len(m.rows.get("kinetic", [])) for m in found),
    }
    for key in ("dancers", "frames", "fps"):
        about[key] = sorted({getattr(m, key) for m in found})
    about["kinds"] = dict(Counter(m.kind for m in found))
    return about | {"names": {k: [m.name for m in found if m.kind == k] for k in about["kinds"]}}
