"""Pictures of a bench: quality against computing, and a filmstrip of each system.

Read first: `dancediff.bench.model_bench` · `dancediff.viz.filmstrip`.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dancediff.bench.results import budget_of
from dancediff.motion.motion import Motion
from dancediff.viz.filmstrip import plot_filmstrip, strip_height
from dancediff.viz.palette import dancer_color, dash
from dancediff.viz.style import bare, save_figure, set_legend

MOMENTS = 6  # of a strip


def draw_quality(points: list[dict], metrics: Sequence[str], path: Path) -> None:
    """A row for each metric, against seconds and against dancer windows, for every length.

    ``points``: those of `dancediff.bench.model_bench.ModelBench.points`, at least one.
    """
    import matplotlib.pyplot as plt
    from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter

    lengths = list(points[0]["scores"])
    shape = (len(metrics), 2 * len(lengths))
    figure, panels = plt.subplots(*shape, figsize=(3.2 * shape[1], 2.0 * shape[0]), squeeze=False)
    axes = [(frames, x) for frames in lengths for x in ("spent", "windows")]
    for row, metric in zip(panels, metrics, strict=True):
        for panel, (frames, x) in zip(row, axes, strict=True):
            for k, config in enumerate(dict.fromkeys(p["config"] for p in points)):
                line = mean_line([p for p in points if p["config"] == config], metric, frames, x)
                look = {"color": dancer_color(k), "ls": dash(k), "label": config}
                panel.plot(*line, marker="o", ms=3, lw=1.2, **look)
            words = "seconds of computing" if x == "spent" else "dancer windows"
            bare(panel).set(xscale="log", xlabel=words)
            panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            panel.xaxis.set_major_formatter(EngFormatter(sep=""))
            panel.xaxis.set_minor_formatter(NullFormatter())  # they would write over each other
            panel.set_title(f"{metric}, {frames} frames", loc="left", fontsize=8)
    set_legend(panels[0, 0], fontsize=7)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    save_figure(figure, path, dpi=110)
    plt.close(figure)


def mean_line(points: list[dict], metric: str, frames: str, x: str) -> tuple[list, list]:
    """Means over seeds, budget by budget.

    >>> two = [{"minutes": 1, "spent": s, "scores": {"150": {"GMR": [v, None, None]}}}
    ...        for s, v in ((60, 3.0), (62, 5.0))]
    >>> mean_line(two, "GMR", "150", "spent")
    ([61.0], [4.0])
    """
    budgets = dict.fromkeys(map(budget_of, points))
    groups = [[p for p in points if budget_of(p) == budget] for budget in budgets]
    where = [float(np.mean([p[x] for p in same])) for same in groups]
    values = [_known_mean([p["scores"][frames][metric][0] for p in same]) for same in groups]
    order = np.argsort(where)
    return [where[k] for k in order], [values[k] for k in order]


def _known_mean(values: list[float | None]) -> float:
    """Of the numbers among them, nan where there is none."""
    known = [value for value in values if value is not None and not np.isnan(value)]
    return float(np.mean(known)) if known else np.nan


def draw_strips(dances: dict[str, Motion], path: Path) -> None:
    """A filmstrip for each system, of the same window, one below the other."""
    import matplotlib.pyplot as plt

    heights = [strip_height(dance, MOMENTS) + 0.3 for dance in dances.values()]
    figure, axes = plt.subplots(
        len(dances), 1, figsize=(9.6, sum(heights)), height_ratios=heights, squeeze=False
    )
    for ax, (name, dance) in zip(axes[:, 0], dances.items(), strict=True):
        plot_filmstrip(dance, ax=ax, count=MOMENTS, title=name)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    save_figure(figure, path, dpi=110)
    plt.close(figure)
