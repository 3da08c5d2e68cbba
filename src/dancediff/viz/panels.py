"""Small panels for the lessons: a pure function from numbers to a Figure, and sliders around it.

Read first: `dancediff.viz.plots`.

The functions know nothing of widgets, so that tests and static pages call them directly;
`explore` puts sliders on any of them.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
import torch
from torch import Tensor

from dancediff.diffusion.schedule import q_sample
from dancediff.extensions.energy_condition import has_energy_condition
from dancediff.extensions.genre_condition import genre_condition_of, genres_of
from dancediff.generation.genre_mix import ANY, BY_TEMPO
from dancediff.generation.request import default_of
from dancediff.metrics import corruption
from dancediff.metrics.collision import tif
from dancediff.metrics.physical import fsr, pfc
from dancediff.metrics.rhythm import beat_alignment
from dancediff.motion.motion import Motion
from dancediff.motion.representation import Normalizer, pack, unpack
from dancediff.motion.rotation import axis_angle_to_matrix, matrix_to_rot6d
from dancediff.motion.skeleton import SMPL24
from dancediff.papers.tcdiffpp.losses import LossWeights, tcdiffpp_losses
from dancediff.viz.body import body_points
from dancediff.viz.numbers import plot_schedule, plot_waveform
from dancediff.viz.palette import BEAT, INK, dancer_color
from dancediff.viz.plots import plot_moment
from dancediff.viz.projection import Camera
from dancediff.viz.style import bare, set_title

NOTICED = 0.25  # of the larger value: by so much must a metric change to be named in a title
MOST_ENERGY = 1.5  # of the slider: music of usual loudness, 0.65, then has nearly all there is
NOT_IN_PAPERS = ("seed", "dancers")  # options for which no paper has a value
DAMAGES = ("drag_feet", "jitter", "freeze", "shuffle_time", "overlap_dancers", "mean_pose")
_FRONT = Camera(eye=(0, 1.15, 7.0), target=(0, 0.95, 0), size=(320, 320), focal=900)


def new_figure(width: float, height: float):
    """A Figure that no window manager knows of, so that it is not shown twice."""
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
    figure = new_figure(6.6, 3.4)
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
    set_title(bare(numbers), f"{joint}: rows 1, 2 of its matrix")  # a widget cuts what is wider
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
    figure = new_figure(7.6, 2.9)
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
    figure = new_figure(8.2, 3.3)
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
    plot_schedule(abar, t=t, ax=curve, title=f"Signal: weight {share**0.5:.2f}, power {share:.1%}")
    return figure


def loss_panel(
    x_0: Tensor,
    normalizer: Normalizer,
    slide: float = 0.0,
    shake: float = 0.0,
    closer: float = 0.0,
    seed: int = 0,
):
    """What the five losses say about a guess that is wrong in a known way -> Figure.

    ``slide``: everybody drifts to the side, m/s; ``shake``: every joint trembles, degrees;
    ``closer``: the group is drawn together, 0 not at all .. 1 to one spot.

    Shapes: x_0 (n, f, d) metres and 6-D rotations.
    """
    contact, root, pose = unpack(x_0)
    spread = (root - root.mean(0)) * torch.tensor([1.0, 0.0, 1.0])
    drift = torch.arange(root.shape[1]) / 30 * slide
    root = root - closer * spread + drift[:, None] * torch.tensor([1.0, 0.0, 0.0])
    axis = torch.randn(pose.shape[:-1], generator=torch.Generator().manual_seed(seed))
    pose = pose @ axis_angle_to_matrix(torch.deg2rad(torch.tensor(float(shake))) * axis)
    x_hat, x_0 = normalizer.normalize(pack(contact, root, pose))[None], normalizer.normalize(x_0)
    weights = LossWeights()
    terms = tcdiffpp_losses(x_hat, x_hat, x_0[None], normalizer, weights=weights)
    names = ["simple", "vel", "fk", "contact", "dist"]
    costs = [weights.terms()[name] * terms[name].item() for name in names]
    figure = new_figure(6.6, 2.4)
    ax = bare(figure.subplots())
    ax.barh(range(5), costs, color=[dancer_color(k) for k in range(5)])
    ax.set_yticks(range(5), names)
    ax.invert_yaxis()
    ax.set(xlabel="weighted loss", xlim=(0, 1.15 * max(*costs, 1e-3)))
    for k, cost in enumerate(costs):
        ax.text(cost, k, f" {cost:.3g}", va="center", fontsize=9, color=INK)
    worst = names[max(range(5), key=costs.__getitem__)]
    found = f"“{worst}” costs most" if max(costs) > 1e-6 else "Nobody complains about the truth"
    set_title(ax, found)
    return figure


def metric_panel(
    dance: Motion, beats, damage: str = "drag_feet", amount: float = 0.5, seed: int = 0
):
    """Metrics of a dance that is damaged by a known amount, 0 .. 1; TIF of groups only -> Figure.

    ``damage``: a function of `dancediff.metrics.corruption`, one of `DAMAGES`; ``beats`` seconds.
    """
    if damage not in DAMAGES:
        raise ValueError(f"damage={damage!r} is not one of {', '.join(DAMAGES)}")
    broken = getattr(corruption, damage)(dance, amount, np.random.default_rng(seed))
    metrics: dict[str, Callable] = {
        "FSR, feet slide": fsr,
        "PFC, nobody stands": pfc,
        "BAS, beats met": partial(beat_alignment, beats=beats, direction="music"),
        "MMC, on the beat": partial(beat_alignment, beats=beats, direction="motion"),
    }
    if dance.num_dancers > 1:
        metrics["TIF, bodies collide"] = tif
    figure = new_figure(7.6, 2.2)
    axes, changes = figure.subplots(1, len(metrics)), {}
    for ax, (name, metric) in zip(axes, metrics.items(), strict=True):
        values = [metric(motion.joints()) for motion in (dance, broken)]
        changes[name.split(",")[0]] = abs(values[1] - values[0]) / max(*values, 0.1)
        ax.bar(range(2), values, color=["0.7", dancer_color(1)])
        ax.set_xticks(range(2), ["before", "after"])
        for k, value in enumerate(values):
            ax.text(k, value, f"{value:.2f}", ha="center", va="bottom", fontsize=9, color=INK)
        bare(ax).set(ylim=(0, 1.2 * max(*values, 0.05)), yticks=[])
        ax.set_title(name, loc="left", fontsize=9)
    seen = [name for name, change in changes.items() if change >= NOTICED]
    much = ", ".join(seen) or "nothing"
    title = f"{damage.replace('_', ' ')}, {amount:.0%}; changed by a quarter or more: {much}"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold", color=INK)
    return figure


def explore(panel, **controls):
    """Sliders around a panel: `panel(**values)` is drawn again whenever one is let go.

    ``controls`` are ipywidgets by argument name. Reset brings the first values back; "Pin as A"
    keeps a picture to compare others with. An error of the panel is shown in place of its picture.
    A panel with an argument ``report`` is slow (see `dancediff.viz.lab`): it waits for its button,
    shows its progress, and can be cancelled. A panel that returns figure and dance, or figure,
    dance and song, can be watched in 3-D, beside the pinned one, and heard.

    Returns a `dancediff.viz.explorer.Explorer`, which a notebook shows as widgets.
    """
    from dancediff.viz.explorer import Explorer

    return Explorer(panel, controls)


def slider(low, high, value, label: str, *, step=None, paper=None):
    """A slider that reports when it is let go; whole numbers unless one of them is a fraction.

    ``paper``: what the paper takes, for the label."""
    import ipywidgets as widgets

    whole = all(isinstance(v, int) for v in (low, high, value, step or 1))
    kind = widgets.IntSlider if whole else widgets.FloatSlider
    return kind(
        min=low,
        max=high,
        value=value,
        step=step or (1 if whole else (high - low) / 100),
        description=_with_paper(label, paper),
        continuous_update=False,
        style={"description_width": "initial"},
        layout={"width": "460px"},
    )


def _with_paper(label: str, paper) -> str:
    """A label, with what the paper takes if that is known."""
    if paper is None:
        return label
    return (
        f"{label} (paper: {paper:g})" if isinstance(paper, float) else f"{label} (paper: {paper})"
    )


def choice(options, value, label: str):
    """A drop-down list."""
    import ipywidgets as widgets

    style = {"description_width": "initial"}
    return widgets.Dropdown(options=list(options), value=value, description=label, style=style)


def option(model, name: str, low=None, high=None, *, value=None, label="", choices=()):
    """A control for an option of `generate`: its default, with what the paper takes in the label.

    ``model``: a pipeline. ``low``, ``high``: of a slider; ``value``, ``label``, ``choices``:
    instead of those of the option.

    >>> import dancediff as dd
    >>> option(dd.load("tcdiffpp"), "steps", 1, 50).description
    'steps (paper: 50)'
    """
    one, family = model.request.__dataclass_fields__[name], model.request.family
    usual, paper = (default_of(family, name, preset) for preset in ("packaged", "paper"))
    value, label = usual if value is None else value, label or name.replace("_", " ")
    paper = None if name in NOT_IN_PAPERS else paper
    if low is not None:
        return slider(low, high, value, label, paper=paper)
    label = _with_paper(label, paper)
    return choice(choices or one.metadata["choices"] or (True, False), value, label)


def style_controls(model, *, genre: str = BY_TEMPO) -> dict:
    """Controls for genre and energy by name; none for what a model does not know.

    ``model``: a pipeline.  ``genre``: the first value.

    >>> import dancediff as dd
    >>> list(style_controls(dd.load("lodge")))
    ['genre', 'energy']
    """
    controls, names = {}, genres_of(model.model)
    if names:
        known = (BY_TEMPO, *names, *((ANY,) if genre_condition_of(model.model) else ()))
        controls["genre"] = option(model, "genre", value=genre, choices=known)
    if has_energy_condition(model.model):
        controls["energy"] = option(
            model, "energy", 0.0, MOST_ENERGY, label="energy, times the song's"
        )
    return controls
