r"""Formations: where a group stands, how often that changes, and who passes whom.

Read first: notebook 13 · `dancediff.metrics.posture`. No paper has these metrics. TIF and GMR
do not see a group that stands in one line for half a minute.

Every metric takes joints (n, f, 24, 3) in metres and raises ValueError for NaN, a wrong shape, too
few frames or dancers.

Symbols (axes: n dancers · f frames · k times, twice a second)
    floor   roots on the floor, metres: x lateral, z depth             (n, f, 2)
    shape   the same around the middle of the group, by time           (k, n, 2)
    D       how far two shapes are apart, metres                       (k, k)
"""

from itertools import combinations, permutations

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment
from scipy.spatial import ConvexHull, QhullError
from torch import Tensor

from dancediff.axes import ON_FLOOR
from dancediff.metrics.inputs import as_group

SAMPLE = 0.5  # seconds between the shapes that are compared
LASTS = 2.0  # seconds that a formation is kept, or it is a way from one to another
KEPT = 0.3  # metres a dancer that a formation which is kept may change in that time
FEW = 6  # dancers whose orders are all tried; of more, the best one is searched for
OTHER = 0.5  # metres a dancer between two formations that are not the same
FORMATION_WINDOW = 30.0  # seconds in which formations and crossings are counted
PASSED = 0.2  # metres that a dancer must be beyond another one to have passed


def formations(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""How many different formations a group takes in thirty seconds.

    $$D(a, b) = \min_\pi \tfrac1n \sum_i \lVert \text{shape}_{a,i} - \text{shape}_{b,\pi(i)}\rVert$$

    Shapes are taken twice a second around the middle of the group, so where the group stands does
    not matter, nor who stands where. A shape that is less than 0.3 m from itself two seconds later
    is a formation; the others are on the way. A formation counts if it is 0.5 m or more from every
    one that counted before.

    The mean over windows of 30 s; a rest shorter than a window is ignored, a dance shorter than one
    is a window.

    >>> line = torch.zeros(2, 300, 24, 3)
    >>> line[1, :, :, 0] = 1.5
    >>> formations(line)
    1.0
    >>> line[1, 150:, :, 0], line[1, 150:, :, 2] = 0.0, 1.5          # one behind the other
    >>> formations(line)
    2.0
    """
    floor = _floor(joints, fps, dancers=2)
    size = min(round(FORMATION_WINDOW * fps), floor.shape[1])
    windows = floor[:, : floor.shape[1] // size * size].split(size, dim=1)
    return sum(len(_different(part, fps)) for part in windows) / len(windows)


def crossings(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""How often two dancers change their left-to-right order, in thirty seconds.

    One has passed the other when they were more than 20 cm apart along x in one order and are in
    the other; to and fro within that counts nothing.

    >>> pair = torch.zeros(2, 900, 24, 3)
    >>> pair[0, :, :, 0], pair[1, :, :, 0] = -1.0, 1.0
    >>> pair[:, 450:] = pair[:, 450:].flip(0)
    >>> crossings(pair)
    1.0
    """
    x = _floor(joints, fps, dancers=2)[..., 0]
    count = 0
    for i, j in combinations(range(len(x)), 2):
        gap = x[j] - x[i]
        side = gap[gap.abs() > PASSED].sign()
        count += int((side.diff() != 0).sum())
    return count * FORMATION_WINDOW * fps / x.shape[1]


def hull_area(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""Floor between the dancers, square metres: the convex hull of the roots, mean over time.

    Raises: ValueError for fewer than 3 dancers, who have no area between them.

    >>> corners = torch.tensor([[0.0, 0], [2, 0], [2, 1], [0, 1], [1, 0.5]])
    >>> square = torch.zeros(5, 9, 24, 3)
    >>> square[..., 0], square[..., 2] = corners[:, :1, None], corners[:, 1:, None]
    >>> hull_area(square)
    2.0
    """
    floor = _floor(joints, fps, dancers=3)[:, :: _step(fps)]
    return sum(_area(points) for points in floor.movedim(1, 0).numpy()) / floor.shape[1]


def depth(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""From the dancer in front to the one at the back, metres, mean over frames.

    $$\overline{\max_i z_i - \min_i z_i}$$

    >>> pair = torch.zeros(2, 9, 24, 3)
    >>> pair[1, ..., 2] = 1.5
    >>> depth(pair)
    1.5
    """
    z = _floor(joints, fps, dancers=2)[..., 1]
    return (z.amax(0) - z.amin(0)).mean().item()


def shape_distance(first: Tensor, second: Tensor) -> Tensor:
    """D: mean distance of dancers to those of another shape, whoever stands where there.

    Shapes: first (..., n, 2), second (..., n, 2) -> (...).

    >>> shape_distance(torch.tensor([[0.0, 0], [1, 0]]), torch.tensor([[1.0, 0], [0, 1]])).item()
    0.5
    """
    gap = (first[..., :, None, :] - second[..., None, :, :]).norm(dim=-1)  # (..., n, n)
    n = gap.shape[-1]
    if n > FEW:
        pairs = [linear_sum_assignment(one) for one in gap.reshape(-1, n, n).numpy()]
        found = [one[pair].mean() for one, pair in zip(gap.reshape(-1, n, n), pairs, strict=True)]
        return torch.stack(found).reshape(gap.shape[:-2])
    every = torch.tensor(list(permutations(range(n))))
    return gap[..., torch.arange(n), every].mean(-1).amin(-1)


def _different(floor: Tensor, fps: float) -> list[Tensor]:
    """The formations of a window, none twice; (n, f, 2) -> shapes (n, 2)."""
    shapes = floor[:, :: _step(fps)].movedim(1, 0)
    shapes = shapes - shapes.mean(1, keepdim=True)
    lag = min(round(LASTS / SAMPLE), len(shapes) - 1)
    kept = shape_distance(shapes[: len(shapes) - lag], shapes[lag:]) < KEPT
    found: list[Tensor] = []
    for shape in shapes[: len(shapes) - lag][kept]:
        if all(shape_distance(shape, other) >= OTHER for other in found):
            found.append(shape)
    return found


def _area(points: np.ndarray) -> float:
    """Of the convex hull of (n, 2); 0 if all are on one line, where Qhull finds none."""
    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        return 0.0


def _step(fps: float) -> int:
    return max(1, round(SAMPLE * fps))


def _floor(joints: Tensor, fps: float, *, dancers: int) -> Tensor:
    return as_group(joints, fps, least=1, dancers=dancers)[:, :, 0][..., ON_FLOOR]


FORMATION = {  # name of the metric: the function, its unit
    "formations": (formations, "in 30 s"),
    "crossings": (crossings, "in 30 s"),
    "hull area": (hull_area, "m²"),
    "depth": (depth, "m"),
}
