r"""Table 1 of both papers beside a bench: each number, and each system's place in the order.

Read first: `dancediff.bench.results`.

The papers' numbers are of their data and sizes, ours of ours, so values cannot be compared, only
orders: who is best, second, third by a metric. Of every two systems that the paper tells apart we
count whether they stand in the same order here.

Symbols
    place    1 + how many systems are better; equal values share a place
"""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

COLUMNS = ("metric", "system", "paper", "place in the paper", "here", "place here")


@dataclass(frozen=True)
class PaperTable:
    """A table as printed: values of each system in the order of the metrics."""

    title: str
    data: str
    metrics: list[list[str]]  # name in the paper, ours, "down" or "up"
    systems: dict[str, list[float]]


def paper_tables() -> dict[str, PaperTable]:
    """Both tables, by the paper's name.

    >>> paper_tables()["lodge"].systems["EDGE"][0]
    94.34
    """
    text = Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    return {name: PaperTable(**table) for name, table in tomllib.loads(text).items()}


def places(values: Sequence[float], better: str) -> list[int | None]:
    """The place of each value; None where there is no value.

    >>> places([0.36, 0.10, 0.13, 0.10], "down"), places([9.5, math.nan, 18.5], "up")
    ([4, 1, 3, 1], [2, None, 1])
    """
    sign = 1 if better == "down" else -1
    return [
        None if math.isnan(value) else 1 + sum(sign * other < sign * value for other in values)
        for value in values
    ]


def agreement(paper: Sequence[float], here: Sequence[float]) -> tuple[int, int]:
    """How many pairs stand in the same order here, of those with values that the paper tells apart.

    >>> agreement([1.0, 2.0, 2.0], [10.0, 30.0, 20.0]), agreement([1.0, 2.0], [5.0, 4.0])
    ((2, 2), (0, 1))
    >>> agreement([1.0, 2.0, 3.0], [5.0, 6.0, math.nan])
    (1, 1)
    """
    known = [k for k, value in enumerate(here) if not math.isnan(value)]
    pairs = [(i, j) for i, j in combinations(known, 2) if paper[i] != paper[j]]
    same = [(paper[i] - paper[j]) * (here[i] - here[j]) > 0 for i, j in pairs]
    return sum(same), len(pairs)


def means(points: list[dict], systems: dict[str, str], minutes: float, frames: int) -> dict:
    """Of each system and metric the mean over seeds, the lowest and the highest.

    ``systems``: the class of network of each config, such as {"edge_small": "EDGE"}.

    >>> def point(fid):
    ...     return {"config": "edge", "minutes": 5, "scores": {"150": {"FID_k": [fid]}}}
    >>> means([point(1.0), point(2.0)], {"edge": "EDGE"}, 5, 150)
    {'EDGE': {'FID_k': [1.5, 1.0, 2.0]}}
    """
    found: dict[str, dict[str, list[float]]] = {}
    for point in points:
        if point.get("minutes") == minutes and point["config"] in systems:
            scores = found.setdefault(systems[point["config"]], {})
            for metric, (value, *_) in point["scores"][str(frames)].items():
                scores.setdefault(metric, []).append(math.nan if value is None else value)
    return {
        system: {m: [float(np.mean(v)), min(v), max(v)] for m, v in scores.items()}
        for system, scores in found.items()
    }


def beside(table: PaperTable, found: dict) -> list[list]:
    """Rows of `COLUMNS`: of each metric the systems that both have; none if that are under two.

    Values here are [mean, lowest, highest], in percent where the paper's are: FSR is a share here.
    """
    names = [name for name in table.systems if name in found]
    rows = []
    for k, (theirs, ours, better) in enumerate(table.metrics if len(names) > 1 else []):
        paper = [table.systems[name][k] for name in names]
        times = 100 if "%" in theirs else 1
        here = [[times * value for value in found[name][ours]] for name in names]
        same, pairs = agreement(paper, [value for value, *_ in here])
        arrow = {"down": "↓", "up": "↑"}[better]
        label = f"{theirs} {arrow}: {same} of {pairs} pairs in the same order"
        columns = (names, paper, places(paper, better), here, places([h[0] for h in here], better))
        for n, row in enumerate(zip(*columns, strict=True)):
            rows.append(["" if n else label, *row])
    return rows


def markdown(rows: list[list]) -> str:
    """Rows of `COLUMNS` as a table.

    >>> print(markdown([["GMR ↓", "EDGE", 63.35, 1, [2.5, 2.0, 3.0], 1]]).splitlines()[-1])
    | GMR ↓ | EDGE | 63.35 | 1 | 2.5 [2, 3] | 1 |
    """
    lines = [list(COLUMNS), ["---"] * len(COLUMNS)]
    for row in rows:
        value, low, high = row[4]
        here = f"{value:.3g}" + (f" [{low:.3g}, {high:.3g}]" if low < high else "")
        lines.append([*map(str, row[:4]), here, "-" if row[5] is None else str(row[5])])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def papers_beside(points: list[dict], systems: dict[str, str], minutes: float, frames: int) -> dict:
    """Rows of both tables, by the paper's name; without tables of which too few systems are here.

    >>> papers_beside([], {}, 5, 150)
    {}
    """
    found = means(points, systems, minutes, frames)
    rows = {name: beside(table, found) for name, table in paper_tables().items()}
    return {name: some for name, some in rows.items() if some}
