"""Still pictures: a dance as a filmstrip, its floor paths, its foot contacts, its numbers.

Read first: `dancediff.viz.filmstrip`, `dancediff.viz.charts`, `dancediff.viz.numbers`: what they
draw is had from here, too.

Every ``plot_*`` takes ``ax=None`` and ``title=`` and returns the Axes it drew on. `filmstrip_page`
puts several of them on a page and returns its Figure. Nothing is shown or saved, except by
`save_filmstrip`. A dancer has the same colour and number in all of them.
"""

from pathlib import Path

import numpy as np

from dancediff.axes import ON_FLOOR
from dancediff.motion.motion import Motion
from dancediff.viz.charts import plot_drift, plot_energy, plot_lanes
from dancediff.viz.filmstrip import (
    PAGE,
    beat_frames,
    moments,
    plot_filmstrip,
    plot_moment,
    plot_noise_filmstrip,
    strip_height,
)
from dancediff.viz.numbers import (
    plot_barcode,
    plot_beats,
    plot_features,
    plot_schedule,
    plot_skeleton,
)
from dancediff.viz.palette import BEAT, FLOOR, GRID, INK, MUTED, dancer_color, ink_on, mix, rgb
from dancediff.viz.style import bare, new_axes, save_figure, set_title

__all__ = [
    "filmstrip_page",
    "moments",
    "plot_barcode",
    "plot_beats",
    "plot_contact_strip",
    "plot_drift",
    "plot_energy",
    "plot_features",
    "plot_filmstrip",
    "plot_floor_paths",
    "plot_lanes",
    "plot_moment",
    "plot_noise_filmstrip",
    "plot_schedule",
    "plot_skeleton",
    "save_filmstrip",
]


def filmstrip_page(motion: Motion, *, count: int = 8, song=None, title: str | None = None):
    """A dance on a page: `plot_filmstrip`, and below it the floor paths and the foot contacts.

    Returns a matplotlib Figure. Raises: ValueError when count is not 1..24.

    >>> import torch
    >>> still = Motion(torch.eye(3).expand(1, 9, 24, 3, 3), torch.zeros(1, 9, 3))
    >>> len(filmstrip_page(still, count=2).axes)          # moments, floor, contacts
    3
    """
    from matplotlib.figure import Figure

    if not 1 <= count <= 24:
        raise ValueError(f"count={count} is not in 1..24")
    height = strip_height(motion, count)
    figure = Figure(figsize=(PAGE, height + 3.3), dpi=110, layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=[height, 3.0])  # type: ignore[misc]
    plot_filmstrip(motion, ax=top.subplots(), count=count, song=song)
    floor, feet = bottom.subplots(1, 2, width_ratios=[1, 1.5])
    beats = beat_frames(motion, song) / motion.fps
    plot_floor_paths(motion, ax=floor, title=farthest(motion))
    standing = motion.contacts().unflatten(-1, (2, 2)).amax(-2).mean().item()
    said = f"Feet stand {standing:.0%} of the time"
    plot_contact_strip(motion, ax=feet, beats=beats, title=said)
    name = "" if song is None else f" to “{song.name}”"
    title = title or f"{motion.people}, {motion.duration:.1f} s{name}"
    style = {"fontsize": 12, "color": INK, "fontweight": "bold"}
    figure.suptitle(title, x=0.01, ha="left", parse_math=False, **style)  # "$" in a name
    return figure


def farthest(motion: Motion) -> str:
    """A title for floor paths: who goes how far.

    >>> import torch
    >>> walk = torch.tensor([[[0.0, 1, 0], [0, 1, 2]], [[3.0, 1, 0], [2, 1, 0]]])
    >>> farthest(Motion(torch.eye(3).expand(2, 2, 24, 3, 3), walk))
    'Longest path: dancer 0, 2.0 m'
    """
    far = motion.root[..., ON_FLOOR].diff(dim=1).norm(dim=-1).sum(1)
    who = int(far.argmax())
    return f"{f'Longest path: dancer {who},' if len(far) > 1 else 'A path of'} {far[who]:.1f} m"


def save_filmstrip(motion: Motion, path, song=None) -> Path:
    """Write `filmstrip_page` as a picture; the file appears whole or not at all."""
    path = Path(path)
    save_figure(filmstrip_page(motion, song=song), path, dpi=160)
    return path


def plot_floor_paths(motion: Motion, *, ax=None, title: str | None = None):
    """Where every dancer went, from above; the audience sits below.

    A ring marks the start, a filled disc with the dancer's number the end; a grid line every metre,
    or fewer where somebody goes far.

    Shapes: motion.root (n, f, 3) metres -> Axes.
    """
    from matplotlib.ticker import MultipleLocator

    ax = new_axes(ax, (4.2, 4.0))
    root = motion.root.numpy()
    for k, path in enumerate(root):
        color = dancer_color(k)
        ax.plot(path[:, 0], path[:, 2], color=color, lw=2, solid_capstyle="round", zorder=2)
        ax.plot(*path[0, ON_FLOOR], "o", ms=15, mfc="none", mec=color, mew=1.5, zorder=3)
        end = 4 + k / len(root)  # a disc over another hides its number, too
        ax.plot(*path[-1, ON_FLOOR], "o", ms=13, color=color, mec="white", zorder=end)
        ax.annotate(
            str(k), path[-1, ON_FLOOR], ha="center", va="center", fontsize=8,
            color=ink_on(color), fontweight="bold", zorder=end,
        )  # fmt: skip
    edge = max(0.5, 0.06 * float(np.ptp(root[..., ON_FLOOR], axis=(0, 1)).max()))
    (x0, x1), (z0, z1) = ((root[..., c].min() - edge, root[..., c].max() + edge) for c in (0, 2))
    pad_x, pad_z = (max(0.0, (2.2 - side) / 2) for side in (x1 - x0, z1 - z0))
    # z grows downwards in the picture, towards the audience
    ax.set(xlim=(x0 - pad_x, x1 + pad_x), ylim=(z1 + pad_z, z0 - pad_z))
    step = grid_step(float(max(x1 - x0, z1 - z0)))
    ax.xaxis.set_major_locator(MultipleLocator(step))
    ax.yaxis.set_major_locator(MultipleLocator(step))
    ax.grid(color=GRID, lw=0.6)
    ax.set_axisbelow(True)
    ax.set(xlabel="x lateral (m), audience on this side", ylabel="z depth (m)", facecolor=FLOOR)
    ax.set_aspect("equal", anchor="NW")
    return set_title(bare(ax, keep=()), title)


def grid_step(metres: float) -> int:
    """Metres between the grid lines of a floor so wide: 1, 2 or 5 or ten times as many.

    >>> [grid_step(wide) for wide in (3, 9, 30, 70, 3000)]
    [1, 2, 5, 10, 500]
    """
    steps = (k * 10**power for power in range(9) for k in (1, 2, 5))
    return next((step for step in steps if metres < 8 * step), 10**9)


def plot_contact_strip(motion: Motion, *, ax=None, beats=(), title: str | None = None):
    """Which feet stand on the floor over time: two lanes a dancer, dark where planted.

    The upper lane of each dancer is the left foot, the lower one the right; a lane is as dark as
    the surer of its ankle and toe contacts. Beats (seconds) are ticks.

    Shapes: motion.contact (n, f, 4), else labelled from the joints -> Axes.
    """
    ax = new_axes(ax, (6.0, 2.4))
    feet = (
        motion.contacts().numpy().reshape(motion.num_dancers, -1, 2, 2).max(2)
    )  # (n, f, left/right)
    size = 8 if motion.num_dancers <= 5 else 6  # of the letters beside the lanes
    for k in range(motion.num_dancers):
        color = np.array(rgb(dancer_color(k)))
        for side in range(2):
            shade = feet[k, :, side, None].clip(0, 1)
            picture = 1 - shade * (1 - color) * 0.95
            low = -k - 0.42 + 0.43 * (1 - side)
            ax.imshow(
                picture[None], extent=(0, motion.duration, low, low + 0.37),
                aspect="auto", interpolation="nearest",
            )  # fmt: skip
            ax.text(
                -0.008, low + 0.18, "LR"[side], transform=ax.get_yaxis_transform(),
                ha="right", va="center", fontsize=size, color=MUTED,
            )  # fmt: skip
    for beat in beats:
        if beat <= motion.duration:
            ax.axvline(beat, color=BEAT, lw=0.9, alpha=0.7, ymin=0.965)
    ax.set(
        xlim=(0, motion.duration), ylim=(0.42 - max(motion.num_dancers, 3), 0.62), xlabel="time (s)"
    )
    ax.set_yticks(-np.arange(motion.num_dancers), [f"{k}   " for k in range(motion.num_dancers)])
    ax.xaxis.get_major_locator().set_params(integer=True)
    bare(ax, keep=("bottom",)).tick_params(axis="y", length=0)
    for k, label in enumerate(ax.get_yticklabels()):
        label.set(color=mix(dancer_color(k), INK, 0.25), fontweight="bold", fontsize=10)
    return set_title(ax, title)
