"""Points of a bench as a table: a row for each system, budget and length.

Read first: `dancediff.bench.model_bench` · `dancediff.training.ablation_table`.
"""

import math

from dancediff.metrics.rows import METRICS as KNOWN
from dancediff.training.ablation_table import mean_of_seeds

ARROWS = {metric.name: metric.arrow for metric in KNOWN}
COST = {"million weights": ("weights", 1e6), "minutes spent": ("spent", 60.0)}
COST |= {"thousand dancer windows": ("windows", 1e3)}


def rows_of(points: list[dict]) -> list[dict]:
    """Rows for `dancediff.training.ablation_table.table`.

    Of several seeds the mean, from the lowest to the highest; of one seed, and of the held-out
    dances, the value with its bootstrap interval.

    >>> def point(seed, value):
    ...     return {"config": "edge", "minutes": 5, "seed": seed, "weights": 2e6, "spent": 300,
    ...             "windows": 4000, "scores": {"150": {"GMR": [value, 0.0, 9.0]}}}
    >>> row = rows_of([point(0, 1.0), point(1, 3.0)])[0]
    >>> row["variant"], row["scores"]["GMR"]
    ('edge, 5 min, 150 frames', {'value': 2.0, 'low': 1.0, 'high': 3.0, 'arrow': 'down'})
    """
    rows = []
    seeds: dict[tuple, set] = {}
    for one in points:
        seeds.setdefault((one["config"], budget_of(one)), set()).add(one.get("seed"))
    for one in points:
        key = one["config"], budget_of(one)
        for frames, scores in one["scores"].items():
            name = ", ".join(filter(None, (*key, f"{frames} frames")))
            several = len(seeds[key]) > 1
            row = {"variant": f"{name}, seed {one.get('seed')}", "of": name} if several else {}
            rows.append({"variant": name} | row | {"scores": _cost(one) | _cells(scores)})
    return mean_of_seeds(rows)


def budget_of(point: dict) -> str:
    """What its training was given, in words; empty where nobody trained.

    >>> budget_of({"minutes": 2.5}), budget_of({"given_windows": 20000}), budget_of({})
    ('2.5 min', '20,000 windows', '')
    """
    if "given_windows" in point:
        return f"{point['given_windows']:,} windows"
    return f"{point['minutes']:g} min" if "minutes" in point else ""


def _cost(point: dict) -> dict[str, dict]:
    """What a model is and what it took; nothing of dances that nobody learned."""
    return {
        name: {"value": point[key] / unit if key in point else None, "low": None, "high": None}
        for name, (key, unit) in COST.items()
    }


def _cells(scores: dict[str, list]) -> dict[str, dict]:
    cells = {}
    for metric, values in scores.items():
        numbers = [None if v is None or math.isnan(v) else v for v in values]
        named = dict(zip(("value", "low", "high"), numbers, strict=True))
        cells[metric] = named | {"arrow": ARROWS.get(metric)}
    return cells
