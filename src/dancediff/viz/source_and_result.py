"""A recording and the dance that was made of it, one below the other, at the same moments.

Read first: `dancediff.data.folder.make`.
"""

from pathlib import Path

import numpy as np
from torch import Tensor

from dancediff.motion.motion import Motion
from dancediff.viz.palette import INK, MUTED, dancer_color
from dancediff.viz.style import save_figure

COUNT = 6
WIDE, LINE = 1.6, 0.35  # inches: a panel, a line of text
Source = tuple[Tensor, tuple[int, ...], float]  # joints (f, j, 3) metres, parents, frames a second


def draw_source_and_result(name: str, sources: list[Source], motion: Motion, folder: Path) -> None:
    """Write FOLDER/NAME.png: the source's own bones above, the retargeted dance below.

    Both are seen from the front, at ``COUNT`` moments and at one scale, over a line at their lowest
    joint.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, COUNT)
    seconds = (np.arange(COUNT) + 0.5) / COUNT * motion.num_frames / motion.fps
    joints, parents = motion.joints(), motion.skeleton.parents
    results = [(points, parents, motion.fps) for points in joints]
    panels = []
    for row, (label, dancers) in enumerate((("source", sources), ("result", results))):
        floor = min(points[..., 1].min().item() for points, _, _ in dancers)
        for ax, second in zip(axes[row], seconds, strict=True):
            panels.append((ax, floor, *_draw(ax, dancers, second, floor)))
            ax.set_title(f"{second:.1f} s", fontsize=9, color=MUTED)
        axes[row, 0].set_ylabel(label, color=INK)
    figure.suptitle(name, fontsize=10, color=INK, parse_math=False)
    shape = _share_scale(panels)
    figure.set_size_inches(WIDE * COUNT, 2 * (WIDE * shape + LINE) + LINE)
    save_figure(figure, folder / f"{name}.png", dpi=100)


def _share_scale(panels: list[tuple]) -> float:
    """As many metres in all panels ``(axes, floor, left, right, top)``, whoever is in them.

    Returns how high a panel is, its width being 1.
    """
    half = 0.55 * max(right - left for _, _, left, right, _ in panels)
    high = max(top - floor for _, floor, _, _, top in panels)
    for ax, floor, left, right, _ in panels:
        middle = (left + right) / 2
        ax.set(xlim=(middle - half, middle + half), ylim=(floor - 0.1 * high, floor + 1.1 * high))
    return 1.2 * high / (2 * half)


def _draw(ax, dancers: list[Source], second: float, floor: float) -> tuple[float, float, float]:
    """The bones of all dancers at one moment, from the front, and a line at height ``floor``.

    Returns how far to the left, to the right and upwards they reach.
    """
    ax.axhline(floor, color=MUTED, linewidth=0.8)
    reach = []
    for k, (points, parents, fps) in enumerate(dancers):
        p = points[min(int(second * fps), len(points) - 1)].numpy()
        bones = [(j, parent) for j, parent in enumerate(parents) if parent >= 0]
        x, y = (np.array([[p[a, c], p[b, c], np.nan] for a, b in bones]).ravel() for c in (0, 1))
        ax.plot(x, y, color=dancer_color(k), linewidth=1.5)
        reach.append((p[:, 0].min(), p[:, 0].max(), p[:, 1].max()))
    ax.set_aspect("equal")
    ax.set(xticks=[], yticks=[])
    ax.spines[:].set_visible(False)
    left, right, top = zip(*reach, strict=True)
    return float(min(left)), float(max(right)), float(max(top))
