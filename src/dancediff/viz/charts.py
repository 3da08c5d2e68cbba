"""Pictures of what a dance does over time.

Read first: `dancediff.viz.style`.

Every ``plot_*`` takes ``ax=None`` and ``title=``, and returns the Axes it drew on.
"""

import numpy as np

from dancediff.metrics.drift import POSE_WINDOW
from dancediff.metrics.posture import POSTURE
from dancediff.motion.beats import mean_speed
from dancediff.motion.motion import Motion
from dancediff.viz.palette import BEAT, INK, MUTED, dancer_color, dash
from dancediff.viz.style import bare, new_axes, set_legend, set_title

DRIFT_COLUMNS = 4
LANES = {"x": "x lateral (m)", "z": "z depth (m)"}
HARD, SOFT = "#D55E00", "#0072B2"
SHADE = {HARD: 0.6, SOFT: 0.25}  # opacity: hard ones are darker without colour, too


def plot_energy(
    motion: Motion, *, ax=None, hard=(), soft=(), beats=(), seams=(), dancer: int = 0, title=None
):
    """Mean joint speed of a dancer, with the primitives or cues that lie in it.

    ``hard``, ``soft``: the frames of each, such as those of
    `dancediff.papers.lodge.primitives.primitive_frames`; ``beats`` in seconds, ``seams`` in frames.

    Shapes: hard, soft (p, k) -> Axes; metres a second over seconds.
    """
    ax = new_axes(ax, (7.2, 2.2))
    fps = motion.fps
    v = fps * mean_speed(motion.joints()[dancer])
    ax.plot(np.arange(len(v)) / fps, v, color=dancer_color(dancer), lw=1.3)
    for name, rows, color in (("hard", hard, HARD), ("soft", soft, SOFT)):
        for k, row in enumerate(rows):
            first, last = int(row[0]) / fps, (int(row[-1]) + 1) / fps
            ax.axvspan(first, last, color=color, alpha=SHADE[color], lw=0,
                       label=None if k else name)  # fmt: skip
    for seam in seams:
        ax.axvline(seam / fps, color=MUTED, lw=1, ls="--")
    top = float(np.nan_to_num(v).max()) or 1.0  # also of a statue
    ax.vlines([b for b in beats if b <= motion.duration], 0, 0.06 * top, color=BEAT, lw=1)
    if len(hard) or len(soft):
        set_legend(ax, ncols=2, loc="lower right", bbox_to_anchor=(1, 1))
    bare(ax).set(xlim=(0, motion.duration), xlabel="time (s)", ylabel="speed (m/s)")
    ax.set_ylim(0, max(1.05 * top, ax.get_ylim()[1]))  # as a neighbour may share it
    return set_title(ax, title)


def plot_lanes(motion: Motion, *, ax=None, axis: str = "x", title: str | None = None):
    """Where every dancer stands over time; a number at the end of a line says whose it is.

    ``axis``: "x" from left to right, or "z" from the back to the audience.

    Shapes: motion.root (n, f, 3) metres -> Axes; metres over seconds.
    Raises ``ValueError`` for another axis.
    """
    if axis not in LANES:
        raise ValueError(f"axis={axis!r} is not one of {', '.join(LANES)}")
    ax = new_axes(ax, (7.2, 2.2))
    time = np.arange(motion.num_frames) / motion.fps
    paths = motion.root[..., "xyz".index(axis)].numpy()
    for k, path in enumerate(paths):
        ax.plot(time, path, color=dancer_color(k), lw=2)
    low, high = ax.get_ylim()
    points = ax.get_window_extent().height / ax.figure.dpi * 72
    for k, y in enumerate(spread_out(paths[:, -1], 10 * (high - low) / points)):
        ax.annotate(str(k), (time[-1], y), (4, 0), textcoords="offset points", va="center",
                    fontsize=9, color=dancer_color(k), annotation_clip=False)  # fmt: skip
    bare(ax).set(xlabel="time (s)", ylabel=LANES[axis])
    return set_title(ax, title)


def spread_out(values, gap: float) -> np.ndarray:
    """Values moved as little as needed, so that no two are nearer than ``gap``; order is kept.

    >>> spread_out([1.0, 0.0, 1.0], gap=0.5).tolist()
    [0.75, 0.0, 1.25]
    """
    values = np.array(values, dtype=float)
    order = values.argsort(kind="stable")
    placed = values[order]
    for _ in range(100):  # neighbours push each other until none is too near
        short = gap - np.diff(placed)
        if short.max(initial=0) <= 1e-9:
            break
        push = np.maximum(short, 0) / 2
        placed[:-1] -= push
        placed[1:] += push
    values[order] = placed
    return values


def plot_drift(drifts, *, ax=None, title=None):
    """Posture over time: a panel for each metric, a line for each dance or model.

    ``drifts``: a `dancediff.metrics.drift.Drift`, or {label: Drift}.

    -> the Axes; each metric has a panel inside it.
    """
    drifts = drifts if isinstance(drifts, dict) else {"": drifts}
    names = list(next(iter(drifts.values())).names)
    rows = -(-len(names) // DRIFT_COLUMNS)
    ax = new_axes(ax, (7.6, 1.7 * rows))
    ax.axis("off")
    for k, name in enumerate(names):
        row, column = divmod(k, DRIFT_COLUMNS)
        wide, high = 1 / DRIFT_COLUMNS, 1 / rows
        where = [column * wide + 0.05, 1 - (row + 0.85) * high, 0.8 * wide, 0.6 * high]
        panel = bare(ax.inset_axes(where))
        for line, (label, one) in enumerate(drifts.items()):
            middle = one.seconds + POSE_WINDOW / 2
            look = {"ls": dash(line), "color": dancer_color(line), "label": label}
            panel.plot(middle, one[name], marker="o", ms=2.5, lw=1.3, **look)
        panel.set_ylim(bottom=0)
        panel.set_title(f"{name} ({POSTURE[name][1]})", loc="left", fontsize=8, color=INK)
        if row == rows - 1:
            panel.set_xlabel("time (s)")
    if len(drifts) > 1:
        handles, labels = panel.get_legend_handles_labels()
        set_legend(ax, handles, labels, loc="lower right")
    return set_title(ax, title)
