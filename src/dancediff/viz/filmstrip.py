"""Moments of a dance side by side, as an audience sees them.

Read first: `dancediff.viz.body`, which gives the dancers their shapes, and
`dancediff.viz.projection`, which gives each moment its camera.
"""

import numpy as np

from dancediff.motion.motion import Motion
from dancediff.music.song import as_song
from dancediff.viz.body import (
    body_points,
    dancer_shapes,
    grid_shapes,
    label_spots,
    shadow_shapes,
    to_paths,
)
from dancediff.viz.palette import FLOOR, INK, MUTED, WALL, dancer_color, mix, rgb
from dancediff.viz.projection import Camera, follow
from dancediff.viz.style import new_axes, set_title

PAGE = 9.6  # inches
_LINE = 0.2  # inches that a line of text above a picture takes


def plot_moment(
    points: np.ndarray, camera: Camera, *, ax=None, numbers: bool = True, dancer=None, title=None
):
    """All dancers at one moment, seen by a camera.

    ``dancer``: all bodies are poses of this one, and have its colour.

    Shapes: points (n, 30, 3) metres, from `body.body_points` -> Axes.
    """
    width, height = camera.size
    ax = new_axes(ax, (4.0, 4.0 * height / width))
    _draw_moment(ax, points, camera, numbers=numbers, dancer=dancer)
    ax.set(xlim=(0, width), ylim=(0, height), aspect="equal")
    ax.axis("off")
    return set_title(ax, title)


def _draw_moment(ax, points, camera: Camera, *, at=(0.0, 0.0), numbers=True, dancer=None) -> None:
    """A moment as a picture as large as the camera's, its lower left corner ``at`` a place."""
    from matplotlib.collections import PathCollection
    from matplotlib.patches import Rectangle
    from matplotlib.transforms import Affine2D

    (x, y), (width, height) = at, camera.size
    rows = np.linspace(0, 1, 64)[:, None, None]
    floor, wall = np.array(rgb(FLOOR)), np.array(rgb(WALL))
    ax.imshow(
        floor + (wall - floor) / (1 + np.exp(-(rows - 0.55) * 14)),
        extent=(x, x + width, y, y + height), origin="lower", interpolation="bilinear",
    )  # fmt: skip
    shapes = grid_shapes(camera, width=0.016) + shadow_shapes(points, camera)
    shapes += dancer_shapes(points, camera, halo=0.016, dancer=dancer)
    paths, faces = to_paths(shapes)
    bodies = PathCollection(paths, facecolors=faces, linewidths=0)
    bodies.set_transform(Affine2D().translate(x, y) + ax.transData)
    ax.add_collection(bodies, autolim=False)
    bodies.set_clip_path(Rectangle((x, y), width, height, transform=ax.transData))
    if numbers:
        for k, spot in enumerate(camera.project(label_spots(points))[0]):
            tone = mix(dancer_color(k), INK, 0.3)
            ax.text(x + spot[0], y + spot[1], str(k), ha="center", va="center", fontsize=8,
                    color=tone, clip_on=True)  # fmt: skip


def moments(num_frames: int, count: int, beat_frames=()) -> list[int]:
    """Evenly spaced frames, each moved to the nearest beat where that leaves them apart.

    >>> moments(90, 3)
    [15, 45, 75]
    >>> moments(90, 3, [12, 44, 80])
    [12, 44, 80]
    """
    gap = num_frames / count
    wanted = [min(int((k + 0.5) * gap), num_frames - 1) for k in range(count)]
    beats = np.asarray([b for b in beat_frames if b < num_frames])
    if len(beats) == 0:
        return wanted
    near = [int(beats[np.abs(beats - w).argmin()]) for w in wanted]
    return [b if abs(b - w) < gap / 2 else w for b, w in zip(near, wanted, strict=True)]


def plot_filmstrip(motion: Motion, *, ax=None, count: int = 8, song=None, title: str | None = None):
    """A dance as moments side by side, in one or several rows.

    Moments are evenly spaced; with a song they fall on its beats. Returns the Axes.
    Raises: ValueError when count is not 1..24.

    >>> import torch
    >>> still = Motion(torch.eye(3).expand(1, 9, 24, 3, 3), torch.zeros(1, 9, 3))
    >>> ax = plot_filmstrip(still, count=2)
    >>> [text.get_text() for text in ax.texts if text.get_text().endswith("s")]
    ['0.1 s', '0.2 s']
    """
    if not 1 <= count <= 24:
        raise ValueError(f"count={count} is not in 1..24")
    points = body_points(motion)
    cameras = _cameras(points, motion.fps)
    rows, size = _layout(count, cameras[0])
    if ax is not None:
        rows = _rows_in(ax, count, cameras[0].size)
    ax = new_axes(ax, size)
    beats = beat_frames(motion, song)
    shown = moments(motion.num_frames, count, beats)
    names = [_name_moment(frame, beats, motion.fps) for frame in shown]
    _draw_strip(ax, [(points[:, f], cameras[f]) for f in shown], names, rows)
    return set_title(ax, title)


def plot_noise_filmstrip(
    dances, labels, *, frame: int = 0, fit_all: bool = False, ax=None, title: str | None = None
):
    """The same moment of several versions of a dance side by side, e.g. noisier and noisier ones.

    ``dances`` are Motions, ``labels`` stand above them. Returns the Axes. All share one camera: it
    shows the first dance, whatever flies out of the picture, or all of them if ``fit_all``.

    Raises: ValueError when the numbers of dances and labels differ.
    """
    if len(dances) != len(labels) or not dances:
        raise ValueError(f"{len(dances)} dances need as many labels, at least 1; got {len(labels)}")
    points = [body_points(dance)[:, frame : frame + 1] for dance in dances]
    seen = np.concatenate(points) if fit_all else points[0]
    camera = _cameras(seen, dances[0].fps)[0]
    width, height = _strip_size(1, len(dances), camera.size[0] / camera.size[1])
    ax = new_axes(ax, (width, height + (0.3 if title else 0.0)))
    _draw_strip(ax, [(p[:, 0], camera) for p in points], labels, 1, numbers=False)
    return set_title(ax, title)


def beat_frames(motion: Motion, song) -> np.ndarray:
    """Frames of the beats of a song or of the one in a path, (k,); none without a song."""
    song = as_song(song)
    return np.zeros(0, int) if song is None else np.round(song.beats() * motion.fps).astype(int)


def strip_height(motion: Motion, count: int) -> float:
    """Inches that a filmstrip of so many moments is high."""
    return _layout(count, _cameras(body_points(motion), motion.fps)[0])[1][1]


def _layout(count: int, camera: Camera) -> tuple[int, tuple[float, float]]:
    """Rows of a strip, and its inches."""
    shape = camera.size[0] / camera.size[1]
    rows = _rows(count, shape)
    return rows, _strip_size(rows, -(-count // rows), shape)


def _strip_size(rows: int, columns: int, shape: float) -> tuple[float, float]:
    """Inches of a strip as wide as a page, with a line of text above each row."""
    return PAGE, rows * (PAGE / columns / shape + _LINE)


def _draw_strip(ax, pictures, names, rows: int, *, numbers: bool = True) -> None:
    """Pictures ``(points, camera)`` in rows, each with its name above it, in one Axes."""
    width, height = pictures[0][1].size
    columns = -(-len(pictures) // rows)
    step_x = 1.02 * width
    step_y = height + _LINE / _inches_a_unit(ax, rows, columns, (width, height))
    for k, ((points, camera), name) in enumerate(zip(pictures, names, strict=True)):
        x, y = k % columns * step_x, (rows - 1 - k // columns) * step_y
        _draw_moment(ax, points, camera, at=(x, y), numbers=numbers)
        ax.annotate(name, (x, y + height), (0, 3), textcoords="offset points", fontsize=9,
                    color=MUTED, parse_math=False)  # fmt: skip
    ax.set(xlim=(0, columns * step_x - 0.02 * width), ylim=(0, rows * step_y), aspect="equal")
    ax.axis("off")


def _inches_a_unit(ax, rows: int, columns: int, size) -> float:
    """How large a strip is in an Axes: as wide as it, or as high, with a line above each row."""
    inches = ax.get_window_extent().size / ax.get_figure(root=True).dpi
    wide, high = np.maximum((inches[0], inches[1] - rows * _LINE), 0.5)
    return float(min(wide / (1.02 * size[0] * columns), high / (size[1] * rows)))


def _rows_in(ax, count: int, size) -> int:
    """Rows in which moments are largest in an Axes that is there already."""

    def scale(rows: int) -> float:
        return _inches_a_unit(ax, rows, -(-count // rows), size)

    return max(range(1, count + 1), key=scale)


def _rows(count: int, shape: float) -> int:
    """Rows that bring a block of cells near to three times as wide as high, with few cells empty.

    >>> [_rows(8, shape) for shape in (0.6, 1.0, 2.2)]
    [1, 2, 2]
    """

    def badness(rows: int) -> float:
        columns = -(-count // rows)
        return abs(np.log(columns / rows * shape / 3)) + 0.4 * (columns * rows - count)

    return min(range(1, count + 1), key=badness)


def _cameras(points: np.ndarray, fps: float) -> list[Camera]:
    """Cameras of just the right shape: wide for a line of five, tall for a solo."""
    in_view = np.concatenate([points, label_spots(points)[:, :, None]], axis=2)
    look = {"fps": fps, "elevation": 16.0, "margin": 0.94}
    cameras = follow(in_view, (320.0, 320.0), **look)
    xy = np.stack([c.project(in_view[:, f])[0] for f, c in enumerate(cameras)])
    width, height = np.abs(xy - 160).max((0, 1, 2))
    shape = float(np.clip(width / height, 0.6, 2.2))
    return follow(in_view, (320.0, 320.0 / shape), **look)


def _name_moment(frame: int, beats: np.ndarray, fps: float) -> str:
    at = np.flatnonzero(np.abs(beats - frame) <= 1)
    return f"{frame / fps:.1f} s" + (f" · beat {at[0] + 1}" if len(at) else "")
