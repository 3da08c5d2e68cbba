"""Drift: does a dance stay what it was? Posture, window by window of five seconds.

Read first: notebook 13 · docs/metrics_posture.md · `dancediff.metrics.posture`.

A dance that is sampled segment after segment can begin well and settle into one pose. A mean over
the dance, as all other metrics are, hides that.
"""

import math
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from dancediff.metrics.inputs import as_group
from dancediff.metrics.posture import POSE_WINDOW, POSTURE


@dataclass(frozen=True)
class Drift:
    """Every posture metric in every window; ``str`` is a table with a line for each window.

    ``values`` (metric, window) holds the numbers in the order of `names`, ``seconds`` (window,)
    where the windows begin.
    """

    values: np.ndarray
    seconds: np.ndarray
    names: tuple[str, ...] = tuple(POSTURE)

    def __getitem__(self, name: str) -> np.ndarray:
        """One metric, window by window.

        Raises: KeyError naming the metrics that there are.
        """
        if name not in self.names:
            raise KeyError(f"{name!r} is not one of {', '.join(self.names)}")
        return self.values[self.names.index(name)]

    def thirds(self, name: str) -> tuple[float, float]:
        """Mean of a metric over the first and over the last third of the windows, at least one."""
        row = self[name]
        third = math.ceil(len(row) / 3)
        return float(row[:third].mean()), float(row[-third:].mean())

    def ends(self, name: str) -> tuple[float, float]:
        """A metric in the first and in the last window."""
        row = self[name]
        return float(row[0]), float(row[-1])

    def facts(self) -> dict:
        """As plain JSON."""
        rows = {name: self[name].round(4).tolist() for name in self.names}
        return {"seconds": self.seconds.tolist(), **rows}

    def __str__(self) -> str:
        head = ["seconds", *self.names]
        rows = [
            [f"{start:g}-{start + POSE_WINDOW:g}", *(f"{value:.3g}" for value in column)]
            for start, column in zip(self.seconds, self.values.T, strict=True)
        ]
        widths = [max(map(len, cells)) for cells in zip(head, *rows, strict=True)]
        lines = (zip(cells, widths, strict=True) for cells in (head, *rows))
        return "\n".join("  ".join(c.rjust(w) for c, w in line) for line in lines)


def drift(joints: Tensor, *, fps: float = 30.0) -> Drift:
    """Measure posture in every whole window of five seconds.

    Shapes/units: joints (n, f, 24, 3) metres -> one `Drift` over all dancers.
    Raises: ValueError for a dance shorter than a window, NaN or a wrong shape.

    >>> from dancediff.data.choreographer import choreograph
    >>> dance = choreograph(np.arange(0.5, 15, 0.5), dancers=2, seed=0, seconds=15)[0]
    >>> found = drift(dance.joints())
    >>> found.seconds.tolist(), found["knee bend"].shape
    ([0.0, 5.0, 10.0], (3,))
    """
    size = round(POSE_WINDOW * fps)
    joints = as_group(joints, fps, least=size)
    windows = joints[:, : joints.shape[1] // size * size].split(size, dim=1)
    values = [[metric(part, fps=fps) for part in windows] for metric, _ in POSTURE.values()]
    return Drift(np.array(values), POSE_WINDOW * np.arange(len(windows)))


def ranges(drifts: list[Drift]) -> np.ndarray:
    """Between which values nine tenths of all windows lie: 5 and 95 %, of each metric.

    Shapes: drifts of dances -> (metric, 2), in the order of their names.
    Raises: ValueError when there is none.

    >>> flat = Drift(np.tile(np.arange(101.0), (len(POSTURE), 1)), np.arange(101))
    >>> ranges([flat])[0].tolist()
    [5.0, 95.0]
    """
    if not drifts:
        raise ValueError("drifts is empty; measure at least one dance of five seconds")
    values = np.concatenate([one.values for one in drifts], axis=1)
    return np.quantile(values, (0.05, 0.95), axis=1).T


def in_range(one: Drift, limits: np.ndarray) -> np.ndarray:
    """Share of the windows that lie within limits, as `ranges` returns them.

    A held-out dance has about nine tenths of its windows there.

    Shapes: limits (metric, 2) -> (metric,).

    >>> limits = np.tile([0.0, 2.0], (len(POSTURE), 1))
    >>> in_range(Drift(np.tile([1.0, 2.0, 3.0, 4.0], (len(POSTURE), 1)), np.arange(4)), limits)[0]
    np.float64(0.5)
    """
    low, high = limits[:, :1], limits[:, 1:]
    return ((one.values >= low) & (one.values <= high)).mean(1)


def mean_drift(drifts: list[Drift]) -> Drift:
    """Mean over dances, window by window, as far as the shortest goes.

    Raises: ValueError when there is none.

    >>> two = [Drift(np.full((len(POSTURE), k), k), np.arange(k)) for k in (2, 4)]
    >>> mean_drift(two)["turning"].tolist()
    [3.0, 3.0]
    """
    if not drifts:
        raise ValueError("drifts is empty; measure at least one dance of five seconds")
    shortest = min(len(one.seconds) for one in drifts)
    values = np.mean([one.values[:, :shortest] for one in drifts], axis=0)
    return Drift(values, drifts[0].seconds[:shortest])
