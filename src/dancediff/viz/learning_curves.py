"""How a training goes: its log, its metrics and the newest dance, as a picture that keeps up.

Read first: docs/training.md, which says what a run writes into its folder.
"""

import csv
import threading
import time
from html import escape
from pathlib import Path

import numpy as np

from dancediff.viz.palette import GRID, INK, MUTED, dancer_color, dash
from dancediff.viz.still import as_output, show_with_still
from dancediff.viz.style import as_png, bare, set_legend, set_title

POINTS = 300  # of a curve: more steps are averaged
NOT_LOSSES = ("step", "seconds", "lr", "gradient", "validation")
METRICS_A_ROW = 5
WIDTH = 9.6  # inches
QUIET = 120.0  # seconds without a new step after which a run has ended or stands still
AGAIN = "run this cell again to look on"

_newest: dict[Path, "LearningCurves"] = {}  # of each folder the one that was shown last


class LearningCurves:
    """What `learning_curves` returns; ``box`` is the widget that a notebook shows."""

    def __init__(self, folder: Path, every: float):
        self.folder, self.every = folder, every
        self.stopped = threading.Event()
        self.box = None
        self._drawn: tuple = ()
        self._stills: list = []  # one wherever it is shown
        self._thread: threading.Thread | None = None

    def figure(self):
        """The curves as they are now, as a matplotlib Figure."""
        return draw_curves(self.folder)

    def _ipython_display_(self) -> None:
        box = self.box or self._make_box()
        self._stills.append(show_with_still(box, self.picture.value))
        before = _newest.get(self.folder.resolve())
        if before is not None and before is not self:  # the cell was run again
            before.stopped.set()
        _newest[self.folder.resolve()] = self
        if self._thread is None or not self._thread.is_alive():
            self.stopped.clear()
            self.button.disabled = False
            self._thread = threading.Thread(target=self.follow, daemon=True)
            self._thread.start()

    def _make_box(self):
        try:
            import ipywidgets as widgets
        except ImportError as err:
            raise ImportError(
                'the panel needs ipywidgets: pip install "dancediff[notebooks]", or draw figure()'
            ) from err
        layout = {"max_width": "100%", "align_self": "flex-start"}
        self.picture = widgets.Image(value=as_png(self.figure()), format="png", layout=layout)
        self.message = widgets.HTML()
        self.button = widgets.Button(description="Stop looking", icon="stop")
        self.button.on_click(lambda _: self.stopped.set())
        self.box = widgets.VBox([widgets.HBox([self.button, self.message]), self.picture])
        self._drawn = self._changes()
        return self.box

    def follow(self) -> None:
        """Draw anew whenever the run has written something, until it has been quiet for long."""
        seen, trouble = time.monotonic(), ""
        while not self.stopped.wait(self.every) and time.monotonic() - seen < QUIET:
            try:
                if self._draw_news():
                    seen, trouble = time.monotonic(), ""
            except Exception as error:  # such as of a picture that is still being written
                trouble = f"{type(error).__name__}: {escape(str(error))}"
            self.message.value = trouble or f"newest step {time.monotonic() - seen:.0f} s ago"
        self.button.disabled = True
        self.message.value = f"{trouble} · {AGAIN}" if trouble else AGAIN
        for still in self._stills:
            still.update(as_output(self.picture.value))

    def _draw_news(self) -> bool:
        """Whether there was something new to draw."""
        changes = self._changes()
        if changes == self._drawn:
            return False
        self.picture.value = as_png(self.figure())
        self._drawn = changes
        return True

    def _changes(self) -> tuple:
        files = [self.folder / name for name in ("losses.csv", "metrics.csv")]
        files += _filmstrips(self.folder)[-1:]
        return tuple((file, file.stat().st_mtime_ns) for file in files if file.exists())


def learning_curves(folder, *, every: float = 5.0) -> LearningCurves:
    """Losses, validation loss, learning rate, gradient and metrics of a training's folder.

    A notebook shows them with the newest filmstrip of the previews, and looks every ``every``
    seconds for more while the run goes on, also one that another program runs. Elsewhere
    ``learning_curves(folder).figure()`` is a matplotlib Figure.

    Raises: ValueError when the folder holds no log.

    >>> learning_curves("runs/nowhere")
    Traceback (most recent call last):
    ValueError: 'runs/nowhere' holds no losses.csv; name the folder of a training
    """
    folder = Path(folder)
    if not (folder / "losses.csv").exists():
        stages = sorted(path.parent.name for path in folder.glob("*/losses.csv"))
        hint = f"one of its stages: {', '.join(stages)}" if stages else "the folder of a training"
        raise ValueError(f"{str(folder)!r} holds no losses.csv; name {hint}")
    return LearningCurves(folder, every)


def read_columns(path: Path) -> dict[str, np.ndarray]:
    """The columns of a log; empty cells are NaN, a line that is still being written is left out.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "losses.csv"
    >>> _ = path.write_text("step,total,validation\\n0,3,\\n1,2,2.5\\n2,1")
    >>> read_columns(path)["validation"]
    array([nan, 2.5])
    """
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    rows = list(csv.reader(line for line in lines if line.endswith("\n")))
    names = rows[0] if rows else []
    whole = [row for row in rows[1:] if len(row) == len(names)]
    cells = [[float(cell) if cell else np.nan for cell in row] for row in whole]
    return dict(zip(names, np.array(cells).reshape(len(whole), len(names)).T, strict=True))


def draw_curves(folder: Path):
    """All panels of a folder as one Figure."""
    from matplotlib.figure import Figure
    from matplotlib.image import imread

    log = read_columns(folder / "losses.csv")
    path = folder / "metrics.csv"
    metrics = read_columns(path) if path.exists() else {}
    names = [name for name in metrics if name != "step"]
    rows, strips = -(-len(names) // METRICS_A_ROW), [imread(p) for p in _filmstrips(folder)[-1:]]
    heights = [2.6, *([1.4 * rows] if rows else [])]
    heights += [0.75 * WIDTH * len(strip) / len(strip[0]) for strip in strips]
    figure = Figure(figsize=(WIDTH, sum(heights)), dpi=100, layout="constrained")
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    _draw_log(parts[0], log)
    if rows:
        axes = parts[1].subplots(rows, METRICS_A_ROW, squeeze=False).ravel()
        for ax, name in zip(axes, names, strict=False):
            bare(ax).plot(metrics["step"], metrics[name], "o-", ms=2.5, lw=1.2, color=INK)
            ax.set_title(name, loc="left", fontsize=8, color=MUTED, parse_math=False)
        parts[1].supxlabel("steps", fontsize=9, color=MUTED)
        for ax in axes[len(names) :]:
            ax.axis("off")
    if strips:
        ax = parts[-1].subplots()
        ax.imshow(strips[0])
        ax.axis("off")
    return figure


def _draw_log(part, log: dict[str, np.ndarray]) -> None:
    """Losses, validation loss, and learning rate with the gradient."""
    losses, validation, speed = part.subplots(1, 3)
    steps = log.get("step", np.zeros(0)) + 1
    mark = {"marker": "o", "ms": 2.5} if len(steps) == 1 else {}  # a line needs two points
    for k, name in enumerate(name for name in log if name not in NOT_LOSSES):
        line = {"color": INK, "lw": 1.6} if name == "total" else {"color": dancer_color(k), "lw": 1}
        losses.plot(*_thinned(steps, log[name]), ls=dash(k), label=name, **line, **mark)
    if (log.get("total", np.zeros(1)) > 0).all():  # as it is of most losses
        losses.set_yscale("log", nonpositive="mask")
    set_legend(losses, loc="center left", bbox_to_anchor=(1, 0.5))  # beside the curves, not on them
    said = "1 step" if len(steps) == 1 else f"{len(steps)} steps"
    set_title(bare(losses), f"After {said}").set(xlabel="steps", ylabel="loss")
    found = ~np.isnan(log.get("validation", np.zeros(len(steps)) + np.nan))
    if found.any():
        at, values = steps[found], log["validation"][found]
        best = int(values.argmin())
        validation.plot(at, values, "o-", ms=2.5, lw=1.2, color=INK)
        validation.axvline(at[best], color=GRID, lw=1, ls="--")
        set_title(validation, f"Best at {at[best]:.0f}: {values[best]:.3g}")
    else:
        set_title(validation, "No validation (yet)")
    bare(validation).set(xlabel="steps", ylabel="validation loss")
    rate = bare(speed).twinx()
    for ax, name, look in (
        (speed, "gradient", {"lw": 1, "color": MUTED}),
        (rate, "lr", {"lw": 1.6, "color": dancer_color(0), "ls": "--"}),
    ):
        ax.plot(*_thinned(steps, log.get(name, steps * np.nan)), **look, **mark)
    bare(rate, keep=("right",)).set_ylabel("learning rate (dashed)")
    speed.set(xlabel="steps", ylabel="gradient")
    set_title(speed, "Gradient and learning rate")


def _filmstrips(folder: Path) -> list[Path]:
    """Pictures of previews from the first to the newest; those of stages lie one folder up."""
    for place in (folder, folder.parent):
        if found := sorted((place / "previews").glob("step_*.png")):
            return found
    return []


def _thinned(steps: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of equal parts, where there are more steps than can be seen.

    >>> _thinned(np.arange(600.0), np.arange(600.0))[1][:2]
    array([0.5, 2.5])
    """
    size = -(-len(steps) // POINTS)
    if size <= 1:
        return steps, values
    whole = len(steps) // size * size
    middle, mean = (one[:whole].reshape(-1, size).mean(1) for one in (steps, values))
    return middle, mean
