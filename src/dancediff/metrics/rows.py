r"""The lines of a table of metrics: value, bootstrap interval, and a reason where one is lacking.

Read first: `dancediff.metrics.measure` and `dancediff.metrics.bootstrap`.

Symbols (axes: N dances · d features)
    parts   the feature vectors (rows, d) or numbers (windows,) of each dance   N of them
    chosen  which dances a number is computed from, some more than once in a resample   (N,)
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from dancediff.metrics.bootstrap import bootstrap_interval
from dancediff.metrics.drift import in_range, ranges
from dancediff.metrics.fidelity import diversity, fid, too_few
from dancediff.metrics.formation import FORMATION
from dancediff.metrics.group import gmr
from dancediff.metrics.measure import BELOW, LAST_OVER_FIRST, OBEDIENCE, Measured
from dancediff.metrics.posture import POSTURE
from dancediff.metrics.swaps import KINDS as SWAP_KINDS

LEVEL, DRAWS = 0.95, 200  # of the bootstrap
IN_RANGE = ", in range"  # of a metric of posture: windows of 5 s
LEAST_WINDOWS = 20  # of a genre in the reference, to know its 5 and 95 %
MOST = 1500  # vectors of which Div takes all pairs
NO_REFERENCE = "no reference set was given"
NO_RATIO = "it is 0 in the first window of every dance, so there is no ratio"
DOWN, UP, ALIKE = "down", "up", "reference"


def mean(numbers: Tensor) -> float:
    """Of the numbers of some dances."""
    return float(numbers.mean())


@dataclass(frozen=True)
class Metric:
    """A line of the table. ``compare(features, reference)`` makes a number of many vectors."""

    name: str
    source: str  # what `measure` calls the vectors or numbers it is made of
    unit: str
    arrow: str
    compare: Callable[[Tensor, Tensor], float] | None = None  # None: the mean of the numbers
    whole: bool = False  # one number for each dance, whatever the window
    optional: bool = False  # no row where no dance has it
    number: Callable[[Tensor], float] = mean  # of all numbers, where there is no compare


def last_over_first(ends: Tensor) -> float:
    """Ratio of the means, nan where the first is 0; ends (N, 2).

    >>> last_over_first(torch.tensor([[1.0, 2.0], [3.0, 2.0]]))
    1.0
    """
    first, last = ends.mean(0).tolist()
    return last / first if first else math.nan


METRICS = (
    Metric("FID_k", "kinetic", "", DOWN, fid),
    Metric("FID_g", "geometric", "", DOWN, fid),
    Metric("Div_k", "kinetic", "", ALIKE, diversity),
    Metric("Div_g", "geometric", "", ALIKE, diversity),
    Metric("GMR", "group", "", DOWN, gmr),
    Metric("GMC", "GMC", "", ALIKE),
    Metric("unison", "unison", "-1 … 1", ALIKE),
    Metric("TIF", "TIF", "pairs a frame", DOWN),
    Metric("MMC", "MMC", "0 … 1", UP),
    Metric("BAS", "BAS", "0 … 1", UP),
    Metric("PFC", "PFC", "cm² a step²", DOWN),
    Metric("FSR", "FSR", "share", DOWN),
    Metric(BELOW, BELOW, "cm", DOWN),
    Metric("abrupt swaps", "abrupt swaps", "a dance", DOWN, whole=True),
    Metric(OBEDIENCE, OBEDIENCE, "share", UP, whole=True),
    *(
        Metric(name, name, "share", UP, whole=True, optional=True)
        for name in (f"{OBEDIENCE}, {kind}" for kind in SWAP_KINDS)
    ),
    Metric("joint speed", "joint speed", "m/s", ALIKE),
    Metric("motion beats", "motion beats", "1/s", ALIKE),
    *(Metric(name, name, unit, ALIKE) for name, (_, unit) in POSTURE.items()),
    *(Metric(name, name, unit, ALIKE, whole=True) for name, (_, unit) in FORMATION.items()),
    *(
        Metric(name, name, "1", ALIKE, whole=True, optional=True, number=last_over_first)
        for name in (f"{posture}{LAST_OVER_FIRST}" for posture in POSTURE)
    ),
    *(
        Metric(name, name, "share", UP, whole=True, optional=True)
        for name in (f"{posture}{IN_RANGE}" for posture in POSTURE)
    ),
)


@dataclass(frozen=True)
class Row:
    """A metric's value. ``low`` and ``high`` are None where one dance allows no interval.

    ``n`` dances gave ``samples`` numbers or vectors. ``arrow`` says what is better: "down", "up",
    or "reference", which is to be near the reference's value ``reference``. ``reason`` says why
    the value is nan, or what it lacks.
    """

    name: str
    value: float
    low: float | None
    high: float | None
    n: int
    samples: int
    unit: str
    arrow: str
    reference: float | None = None
    reason: str = ""


def table_rows(
    dances: list[Measured],
    reference: list[Measured] | None,
    *,
    metrics: tuple[str, ...] = (),
    seed: int = 0,
) -> Iterator[Row]:
    """A row for each metric, of dances and a reference set as `measure` left them.

    Kinds of swaps that no dance has as its target have no row, nor has drift of short dances.
    ``metrics`` of the user's own come last.
    """
    if reference:
        dances = _with_shares_in_range(dances, reference)
    for metric in (*METRICS, *(Metric(name, name, "", ALIKE) for name in metrics)):
        if not metric.optional or any(metric.source in dance.numbers for dance in dances):
            yield _row(metric, dances, reference, seed)


def _with_shares_in_range(dances: list[Measured], reference: list[Measured]) -> list[Measured]:
    """With the share of windows in the range of the reference, of the dance's genre if it can."""
    known = [one for one in reference if one.drift is not None]
    if not known:
        return dances
    limits: dict[str | None, np.ndarray] = {None: ranges([one.drift for one in known if one.drift])}
    for genre in {one.genre for one in known} - {None}:
        same = [one.drift for one in known if one.drift and one.genre == genre]
        if sum(len(one.seconds) for one in same) >= LEAST_WINDOWS:
            limits[genre] = ranges(same)
    found = []
    for dance in dances:
        numbers = dict(dance.numbers)
        if dance.drift is not None:
            shares = in_range(dance.drift, limits.get(dance.genre, limits[None]))
            for name, share in zip(dance.drift.names, shares, strict=True):
                numbers[f"{name}{IN_RANGE}"] = [float(share)]
        found.append(replace(dance, numbers=numbers))
    return found


def _row(
    metric: Metric, dances: list[Measured], reference: list[Measured] | None, seed: int
) -> Row:
    parts = _parts(metric, dances)
    if metric.compare is diversity:
        parts = _sample(parts, seed)
    row = Row(
        name=metric.name,
        value=math.nan,
        low=None,
        high=None,
        n=len(parts),
        samples=sum(map(len, parts)),
        unit=metric.unit,
        arrow=metric.arrow,
        reference=_of_reference(metric, reference),
    )
    if why := _why_not(metric, dances, reference):
        return replace(row, reason=why)
    real = torch.empty(0)
    if metric.compare and reference:
        real = _joined(_parts(metric, reference))

    def statistic(chosen) -> float:
        features = _joined([parts[int(k)] for k in chosen])
        return metric.compare(features, real) if metric.compare else metric.number(features)

    everyone = torch.arange(len(parts))
    try:
        row = replace(row, value=statistic(everyone), reason=_lacks(metric, parts, dances, real))
        if math.isnan(row.value):
            return replace(row, reason=NO_RATIO)
        if len(parts) > 1:
            low, high = bootstrap_interval(statistic, everyone, level=LEVEL, draws=DRAWS, seed=seed)
            if metric.compare in (fid, gmr):  # moved onto the value, it may reach below what can be
                low = max(low, 0.0)
            row = replace(row, low=low, high=high)
    except ValueError as err:
        row = replace(row, reason=" ".join(str(err).split()))
    return row


def _parts(metric: Metric, dances: list[Measured]) -> list[np.ndarray]:
    """What there is of a metric, one array for each dance that has any."""
    join = np.array if metric.compare is None else np.concatenate
    return [join(entries) for dance in dances if (entries := _entries(metric, dance))]


def _entries(metric: Metric, dance: Measured) -> list:
    """One entry for each window (or whole dance) that has the metric."""
    kept = dance.numbers if metric.compare is None else dance.rows
    return kept.get(metric.source, [])


def _sample(parts: list[np.ndarray], seed: int) -> list[np.ndarray]:
    """Dances drawn until there are `MOST` vectors: all pairs of more take too long."""
    order = np.random.default_rng(seed).permutation(len(parts))
    ends = np.cumsum([len(parts[k]) for k in order])
    return [parts[k] for k in np.sort(order[: np.searchsorted(ends, MOST) + 1])]


def _joined(parts: list[np.ndarray]) -> Tensor:
    return torch.from_numpy(np.concatenate(parts))


def _why_not(metric: Metric, dances: list[Measured], reference: list[Measured] | None) -> str:
    """Why a metric has no value; empty if it may have one."""
    if metric.compare and reference is None:
        return NO_REFERENCE
    sides = [("", dances), *([("reference: ", reference or [])] if metric.compare else [])]
    rates = {dance.fps for _, side in sides for dance in side}
    for name, side in sides:
        if not any(_entries(metric, dance) for dance in side):
            return name + next(iter(_missing(metric, side)), "no dance has it")
    if len(rates) > 1 and not metric.whole:
        words = " and ".join(f"{fps:g}" for fps in sorted(rates))
        return f"dances have {words} frames a second; bring them to one rate (resample_motion)"
    return ""


def _lacks(metric: Metric, parts: list, dances: list[Measured], real: Tensor) -> str:
    """What a reader must know about a value that there is."""
    words = []
    if len(parts) < (count := len(_parts(metric, dances))):
        words.append(f"of {len(parts)} of {count} dances, drawn at random")
    if gone := _missing(metric, dances):
        of = len(gone) + sum(len(_entries(metric, dance)) for dance in dances)
        words.append(f"{len(gone)} of {of} left out: {gone[0]}")
    if metric.compare in (fid, gmr):
        few = too_few(_joined(parts), "dances"), too_few(real, "reference")
        words += [text for text in few if text]
    return "; ".join(words)


def _missing(metric: Metric, dances: list[Measured]) -> list[str]:
    return [why for dance in dances for why in dance.missing.get(metric.source, [])]


def _of_reference(metric: Metric, reference: list[Measured] | None) -> float | None:
    """The metric of the reference set itself; None where it makes no sense or there is none."""
    dances = reference or []
    mixed = len({dance.fps for dance in dances}) > 1
    if (
        (mixed and not metric.whole)
        or metric.compare in (fid, gmr)
        or not (parts := _parts(metric, dances))
    ):
        return None
    x = _joined(_sample(parts, 0) if metric.compare is diversity else parts)
    try:
        return float(metric.compare(x, x) if metric.compare else metric.number(x))
    except ValueError:
        return None
