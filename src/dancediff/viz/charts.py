"""Pictures of what a dance does over time, of losses, and of metrics side by side.

Every ``plot_*`` takes ``ax=None`` and ``title=``, and returns the Axes it drew on.
"""

import csv
from itertools import combinations
from pathlib import Path

import numpy as np

from dancediff.axes import ON_FLOOR
from dancediff.metrics.drift import POSE_WINDOW
from dancediff.metrics.posture import POSTURE
from dancediff.motion.beats import mean_speed, motion_beats
from dancediff.motion.motion import Motion
from dancediff.viz.palette import BEAT, GRID, INK, MUTED, dancer_color
from dancediff.viz.style import bare, new_axes, set_title

TOUCH = 0.3  # metres between roots at which bodies are as good as touching
DRIFT_COLUMNS = 4
HARD, SOFT = "#D55E00", "#0072B2"


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
            ax.axvspan(first, last, color=color, alpha=0.3, lw=0, label=None if k else name)
    for seam in seams:
        ax.axvline(seam / fps, color=MUTED, lw=1, ls="--")
    ax.vlines([b for b in beats if b <= motion.duration], 0, 0.06 * v.max(), color=BEAT, lw=1)
    if len(hard) or len(soft):
        ax.legend(frameon=False, fontsize=8, ncols=2, loc="lower right", bbox_to_anchor=(1, 1))
    bare(ax).set(xlim=(0, motion.duration), xlabel="time (s)", ylabel="speed (m/s)")
    return set_title(ax, title)


def plot_beat_alignment(motion: Motion, beats, *, ax=None, within: int = 2, title=None):
    """A lane for each dancer: a mark at every motion beat, filled if the music has a beat there.

    ``beats`` in seconds; ``within``: frames by which a hit may be off. -> Axes
    """
    ax = new_axes(ax, (7.2, 0.5 + 0.35 * motion.num_dancers))
    beats = np.asarray([b for b in beats if b <= motion.duration])
    ax.vlines(beats, -0.5, motion.num_dancers - 0.5, color=BEAT, lw=1, alpha=0.6)
    hits = moments = 0
    for k in range(motion.num_dancers):
        at = motion_beats(motion.joints()[k]) / motion.fps
        near = np.zeros(len(at), bool)
        if len(beats):
            near = np.abs(at[:, None] - beats).min(1) <= (within + 1e-6) / motion.fps
        hits, moments = hits + near.sum(), moments + len(at)
        color = dancer_color(k)
        ax.plot(at[near], np.full(near.sum(), k), "o", ms=6, color=color)
        ax.plot(at[~near], np.full((~near).sum(), k), "o", ms=6, mfc="none", color=color)
    ax.set_yticks(range(motion.num_dancers), [str(k + 1) for k in range(motion.num_dancers)])
    bare(ax, keep=("bottom",)).set(xlim=(0, motion.duration), xlabel="time (s)")
    ax.invert_yaxis()
    share = hits / moments if moments else 0.0
    return set_title(ax, title or f"{share:.0%} of {moments} rests lie on a beat")


def plot_distances(motion: Motion, *, ax=None, title=None):
    """How far apart the roots of every two dancers are, a row for each pair, dark where near.

    -> Axes; the title says how near they ever come.
    Raises: ValueError for a solo.
    """
    if motion.num_dancers < 2:
        raise ValueError("plot_distances needs at least 2 dancers; this dance has 1")
    pairs = list(combinations(range(motion.num_dancers), 2))
    ax = new_axes(ax, (7.2, 0.7 + 0.26 * len(pairs)))
    floor = motion.root[..., ON_FLOOR]
    rows = np.stack([(floor[a] - floor[b]).norm(dim=-1).numpy() for a, b in pairs])
    picture = ax.imshow(
        rows, aspect="auto", cmap="cividis", vmin=0, vmax=max(3.0, float(rows.max())),
        extent=(0, motion.duration, len(pairs) - 0.5, -0.5), interpolation="nearest",
    )  # fmt: skip
    for k, row in enumerate(rows):
        close = np.flatnonzero(row < TOUCH) / motion.fps
        ax.plot(close, np.full(len(close), k), "|", color=HARD, ms=6)
    ax.set_yticks(range(len(pairs)), [f"{a + 1} and {b + 1}" for a, b in pairs])
    bare(ax, keep=()).set(xlabel="time (s)")
    bar = ax.figure.colorbar(picture, ax=ax, pad=0.01)
    bar.set_label("metres apart", color=MUTED, fontsize=8)
    bar.ax.tick_params(labelsize=7, colors=MUTED)
    return set_title(ax, title or f"Nearest: {rows.min():.2f} m")


def plot_losses(losses, *, ax=None, names=None, smooth: int = 50, title=None):
    """Losses over steps, each divided by its first mean, so that all of them are seen.

    ``losses``: the ``losses.csv`` of a training, or {name: values}; ``smooth``: steps that one
    point is the mean of.

    -> Axes, logarithmic.
    Raises: ValueError when there are fewer than 2 steps, or a name is not there.
    """
    curves = dict(losses) if isinstance(losses, dict) else read_losses(losses)
    names = list(curves) if names is None else list(names)
    for name in names:
        if name not in curves:
            raise ValueError(f"names: {name!r} is not one of {', '.join(curves)}")
        if len(curves[name]) < 2:
            raise ValueError(f"{name} has {len(curves[name])} steps; at least 2 make a line")
    ax = new_axes(ax, (7.2, 2.8))
    for k, name in enumerate(names):
        y = np.asarray(curves[name], float)
        width = max(1, min(smooth, len(y) // 2))
        means = y[: len(y) // width * width].reshape(-1, width).mean(1)
        steps = (np.arange(len(means)) + 0.5) * width
        style = "-" if k < 6 else "--"
        ax.plot(
            steps, means / max(means[0], 1e-12), style, lw=1.4, color=dancer_color(k), label=name
        )
    bare(ax).set(yscale="log", xlabel="step", ylabel="loss, of its first mean")
    ax.legend(frameon=False, fontsize=8, ncols=4)
    return set_title(ax, title)


def plot_drift(drifts, *, ax=None, names=None, title=None):
    """Posture over time: a panel for each metric, a line for each dance or model.

    ``drifts``: a `dancediff.metrics.drift.Drift`, or {label: Drift}; ``names``: which metrics.

    -> the Axes; each metric has a panel inside it.
    Raises: KeyError when a name is not there.
    """
    drifts = drifts if isinstance(drifts, dict) else {"": drifts}
    names = list(next(iter(drifts.values())).names) if names is None else list(names)
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
            panel.plot(
                middle, one[name], "o-", ms=2.5, lw=1.3, color=dancer_color(line), label=label
            )
        panel.set_ylim(bottom=0)
        panel.set_title(f"{name} ({POSTURE[name][1]})", loc="left", fontsize=8, color=INK)
        if row == rows - 1:
            panel.set_xlabel("time (s)")
    if len(drifts) > 1:
        handles, labels = panel.get_legend_handles_labels()
        ax.legend(handles, labels, frameon=False, fontsize=8, loc="lower right")
    return set_title(ax, title)


def read_losses(path) -> dict[str, np.ndarray]:
    """The columns of a training's ``losses.csv``, without step and time.

    Raises: ValueError naming the file when it is no such table.
    """
    with Path(path).open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    try:
        head, *body = rows
        table = np.array([[float(v) for v in row] for row in body if len(row) == len(head)])
        return {name: table[:, k] for k, name in enumerate(head) if name not in ("step", "seconds")}
    except (ValueError, IndexError) as err:
        raise ValueError(f"{path} is no losses.csv of a training: {err}") from err


def plot_radar(
    rows: dict[str, dict[str, float]], reference: dict[str, float], *, ax=None, title=None
):
    """Metrics of several dances around a circle, each as a multiple of the reference's, log scale.

    On the thick circle is what the reference has: outside of it more, inside less; a spoke ends at
    4 times and a quarter.

    -> polar Axes.
    Raises: ValueError when a metric of a row is not in the reference, less than 3 are, or ``ax`` is
    not polar.
    """
    import matplotlib.pyplot as plt

    names = [name for name, value in reference.items() if value > 0]
    if len(names) < 3:
        raise ValueError(f"reference has {len(names)} metrics above 0; a radar needs 3")
    for label, values in rows.items():
        missing = [name for name in names if name not in values]
        if missing:
            raise ValueError(f"{label!r} lacks {', '.join(missing)}")
    if ax is None:
        polar = {"projection": "polar"}
        ax = plt.subplots(subplot_kw=polar, figsize=(4.6, 4.2), layout="constrained")[1]
    elif ax.name != "polar":
        raise ValueError(f'ax is {ax.name}; make it with subplot_kw={{"projection": "polar"}}')
    angle = np.linspace(0, 2 * np.pi, len(names), endpoint=False)
    around = np.append(angle, angle[0])
    for k, (label, values) in enumerate(rows.items()):
        ratio = np.array([values[name] / reference[name] for name in names])
        radius = np.log2(np.clip(ratio, 0.25, 4)) + 2
        radius = np.append(radius, radius[0])
        ax.plot(around, radius, "o-", ms=3, lw=1.5, color=dancer_color(k), label=label)
        ax.fill(around, radius, color=dancer_color(k), alpha=0.1)
    ax.plot(np.linspace(0, 2 * np.pi, 100), np.full(100, 2.0), color=INK, lw=1.5)
    ax.set_xticks(angle, names, fontsize=8, color=INK)
    ax.set(ylim=(0, 4))
    ax.set_yticks(range(5), ["¼", "½", "1", "2", "4"], fontsize=7, color=MUTED)
    ax.grid(color=GRID, lw=0.6)
    ax.spines["polar"].set_visible(False)
    ax.legend(frameon=False, fontsize=8, loc="lower left", bbox_to_anchor=(-0.15, -0.12))
    return set_title(ax, title)
