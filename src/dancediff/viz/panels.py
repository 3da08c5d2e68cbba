"""Small panels for the lessons: a pure function from numbers to a Figure, and sliders around it.

The functions know nothing of widgets, so that tests and static pages call them directly;
`explore` puts sliders on any of them.
"""

import io

import torch
from torch import Tensor

from dancediff.diffusion.schedule import q_sample
from dancediff.motion.motion import Motion
from dancediff.motion.representation import Normalizer
from dancediff.motion.rotation import axis_angle_to_matrix, matrix_to_rot6d
from dancediff.motion.skeleton import SMPL24
from dancediff.viz.body import body_points
from dancediff.viz.numbers import plot_schedule, plot_waveform
from dancediff.viz.palette import BEAT, INK, dancer_color
from dancediff.viz.plots import plot_filmstrip, plot_moment
from dancediff.viz.projection import Camera
from dancediff.viz.style import bare, set_title

_FRONT = Camera(eye=(0, 1.15, 7.0), target=(0, 0.95, 0), size=(320, 320), focal=900)


def _figure(width: float, height: float):
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=100, layout="constrained")


def pose_panel(joint: str = "lshoulder", x: float = 0, y: float = 0, z: float = 0):
    """The rest pose with one joint turned, and the six numbers that say so.

    ``x, y, z`` is an axis-angle vector in degrees in the parent joint's frame -> Figure.

    >>> type(pose_panel("lknee", x=90)).__name__
    'Figure'
    """
    R = axis_angle_to_matrix(torch.deg2rad(torch.tensor([x, y, z], dtype=torch.float32)))
    pose = torch.eye(3).repeat(1, 1, 24, 1, 1)
    pose[0, 0, SMPL24.index(joint)] = R
    motion = Motion(pose, torch.tensor([[[0.0, 0.965, 0.0]]]))
    figure = _figure(6.6, 3.4)
    body, numbers = figure.subplots(1, 2)
    plot_moment(body_points(motion)[:, 0], _FRONT, ax=body, numbers=False)
    d6 = matrix_to_rot6d(R)
    numbers.barh(range(6), d6.tolist(), color=[dancer_color(0)] * 3 + [dancer_color(1)] * 3)
    numbers.set(xlim=(-1.15, 1.15), xlabel="value")
    numbers.set_yticks(range(6), [f"row {k // 3 + 1}, {'xyz'[k % 3]}" for k in range(6)])
    numbers.invert_yaxis()
    for k, value in enumerate(d6.tolist()):
        numbers.text(0.03 if value <= 0 else -0.03, k, f"{value:+.2f}", va="center", fontsize=9,
                     ha="left" if value <= 0 else "right", color=INK)  # fmt: skip
    set_title(bare(numbers), f"{joint}: six numbers")
    return figure


def peaks_panel(song, threshold: float = 4.0, start: float = 0.0, seconds: float = 8.0):
    """Which onsets count as peaks when only those above a threshold do.

    -> Figure with the sound, the onset envelope, the peaks and the detected beats.
    """
    from scipy.signal import find_peaks

    M = song.features()[:, [0, 34]].numpy()
    first, last = round(start * 30), min(len(M), round((start + seconds) * 30))
    time, onset = torch.arange(first, last).numpy() / 30, M[first:last, 0]
    peaks, _ = find_peaks(onset, height=threshold)
    beats = time[M[first:last, 1] > 0.5]
    figure = _figure(7.6, 2.9)
    sound, strength = figure.subplots(2, 1, sharex=True, height_ratios=[0.6, 1])
    plot_waveform(song, ax=sound, start=start, stop=start + seconds)
    strength.fill_between(time, onset, color=dancer_color(0), alpha=0.7, lw=0)
    strength.axhline(threshold, color=INK, lw=1, ls="--")
    strength.vlines(beats, 0, onset.max() * 1.05, color=BEAT, lw=1)
    strength.plot(time[peaks], onset[peaks], "v", color=INK, ms=5)
    strength.set(xlim=(time[0], time[-1]), xlabel="time (s)", ylabel="onset strength")
    bare(strength)
    found = f"{len(peaks)} peaks above {threshold:g}, {len(beats)} beats"
    set_title(sound, found)
    return figure


def noise_panel(
    x_0: Tensor, normalizer: Normalizer, abar: Tensor, t: int = 300, frame: int = 60, seed: int = 0
):
    """One moment of a dance after t steps of noise, beside the schedule.

    Shapes: x_0 (n, f, d) normalised; abar (T,) -> Figure.
    """
    eps = torch.randn(x_0.shape, generator=torch.Generator().manual_seed(seed))
    x_t = q_sample(x_0[None], t, abar, eps[None])[0]
    noisy = Motion.from_features(normalizer.unnormalize(x_t))
    points = body_points(noisy)[:, frame]
    figure = _figure(8.2, 3.3)
    moment, curve = figure.subplots(1, 2, width_ratios=[1, 1.1])
    clean = normalizer.unnormalize(x_0)[:, frame, 4:7]
    centre = clean.mean(0).tolist()
    wide = float((clean[:, 0].max() - clean[:, 0].min()) / 2 + 1.3)
    camera = Camera(
        eye=(centre[0], 2.6, centre[2] + 8.0),
        target=(centre[0], 0.9, centre[2]),
        size=(360, 300),
        focal=180 * 8.0 / max(wide, 1.4),
    )
    plot_moment(points, camera, ax=moment, numbers=False)
    share = float(abar[t])
    set_title(moment, f"t = {t}")
    plot_schedule(abar, t=t, ax=curve, title=f"{share:.1%} of the signal's power is left")
    return figure


def dance_panel(model, song, *, dancers: int = 3, seed: int = 0, seconds: float = 5.0, steps=10):
    """Ask a model for a dance and show it as a filmstrip of four moments -> Figure."""
    dance = model.generate(song, dancers=dancers, seconds=seconds, seed=seed, steps=steps)
    title = f"seed {seed}: {dancers} dancers, {steps} denoising steps"
    return plot_filmstrip(dance, count=4, title=title)


def explore(panel, **controls):
    """Sliders around a panel: `panel(**values)` is drawn again whenever one is let go.

    ``controls`` are ipywidgets by argument name. A Reset button brings the first values back. An
    error of the panel is shown in place of the picture.

    Returns an ipywidgets.VBox.
    """
    import ipywidgets as widgets

    first = {name: control.value for name, control in controls.items()}
    picture = widgets.Image(format="png", layout={"max_width": "100%"})
    message = widgets.HTML()

    def draw(*_):
        try:
            values = {name: control.value for name, control in controls.items()}
            picture.value, message.value = as_png(panel(**values)), ""
        except Exception as err:
            message.value = f"<pre>{type(err).__name__}: {err}</pre>"

    def reset(_):
        for name, control in controls.items():
            control.value = first[name]

    for control in controls.values():
        control.observe(draw, names="value")
    button = widgets.Button(description="Reset", icon="undo", layout={"width": "90px"})
    button.on_click(reset)
    draw()
    return widgets.VBox([*controls.values(), button, message, picture])


def slider(low, high, value, label: str, *, step=None):
    """A slider that reports when it is let go; whole numbers unless one of them is a fraction."""
    import ipywidgets as widgets

    whole = all(isinstance(v, int) for v in (low, high, value, step or 1))
    kind = widgets.IntSlider if whole else widgets.FloatSlider
    return kind(
        min=low,
        max=high,
        value=value,
        step=step or (1 if whole else (high - low) / 100),
        description=label,
        continuous_update=False,
        style={"description_width": "initial"},
        layout={"width": "460px"},
    )


def choice(options, value, label: str):
    """A drop-down list."""
    import ipywidgets as widgets

    style = {"description_width": "initial"}
    return widgets.Dropdown(options=list(options), value=value, description=label, style=style)


def as_png(figure) -> bytes:
    """A figure as the bytes of a PNG file."""
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()
