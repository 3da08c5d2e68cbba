"""Panels that dance: sampling, formations and swaps, long dances, Lodge's cues.

Read first: `dancediff.viz.plots` and `dancediff.viz.panels`.

Each asks a model for a dance and returns a Figure whose title says what came of it, and the dance.
They take some seconds; ``report(done, total)`` is called after every denoising step, and whatever
it raises stops them. `dancediff.viz.panels.explore` puts controls, a progress bar and Cancel
around them; `functools.partial` binds what has no control. Options are those of `generate`, with
its defaults:

    explore(partial(sampling_panel, model, song), steps=option(model, "steps", 1, 50))
"""

import numpy as np
import torch

from dancediff.diffusion.samplers import sampling_times
from dancediff.metrics.rhythm import beat_alignment
from dancediff.metrics.swaps import final_order
from dancediff.motion.representation import LODGE
from dancediff.music.features import dance_frames
from dancediff.papers.lodge.choreography import arrange
from dancediff.papers.lodge.cue_guidance import guided_steps
from dancediff.papers.lodge.segments import segments_of
from dancediff.viz.body import body_points
from dancediff.viz.charts import HARD, SHADE, SOFT
from dancediff.viz.palette import INK, MUTED, PAPER, dancer_color, mix
from dancediff.viz.panels import new_figure
from dancediff.viz.plots import (
    farthest,
    filmstrip_page,
    plot_energy,
    plot_floor_paths,
    plot_lanes,
    plot_moment,
)
from dancediff.viz.projection import follow
from dancediff.viz.style import bare, set_title

GUESSES = 6  # moments of the way from noise to dance that are shown
NEAR = 0.05  # metres from the finished dance at which a guess is as good as it
SHORT = {"seconds": 5.0, "steps": 10}  # unless a panel asks for others: nobody shall wait


def dance_panel(model, song, *, report=None, **options):
    """A dance as a filmstrip of four moments -> Figure, Motion, song."""
    dance = model.generate(song, **SHORT | options, progress=report or False)
    made = dance.meta
    speed = dance.fps * dance.joints().diff(dim=1).norm(dim=-1).mean().item()
    title = f"Seed {made['seed']}, {made['steps']} steps: joints move at {speed:.2f} m/s"
    return filmstrip_page(dance, count=4, title=title), dance, song


def sampling_panel(model, song, *, report=None, **options):
    """What the model takes the dance for on the way from noise to it -> Figure, Motion, song."""
    guesses = []
    dance = model.generate(
        song,
        **{"dancers": 2, "seconds": SHORT["seconds"]} | options,
        progress=report or False,
        watch=lambda done, total, guess: guesses.append(guess),
    )
    last = guesses[-1].joints()
    away = [(guess.joints() - last).norm(dim=-1).mean().item() for guess in guesses]
    middle = dance.num_frames // 2
    figure = new_figure(8.2, 4.2)
    top, bottom = figure.subfigures(2, 1, height_ratios=[1, 1.1])
    shown = np.unique(np.linspace(0, len(guesses) - 1, GUESSES).round().astype(int))
    points = [body_points(guesses[k])[:, middle] for k in shown]
    camera = follow(np.concatenate(points)[:, None], (320, 320), margin=0.9)[0]  # sees them all
    panels = top.subplots(1, len(shown), squeeze=False)[0]
    for ax, k, bodies in zip(panels, shown, points, strict=True):
        plot_moment(bodies, camera, ax=ax, numbers=False)
        ax.set_title(f"step {k + 1}", loc="left", fontsize=9, color=MUTED, pad=3)
    ax = bare(bottom.subplots())
    ax.plot(range(1, len(away) + 1), 100 * np.array(away), "o-", ms=3, color=dancer_color(0))
    ax.xaxis.get_major_locator().set_params(integer=True)
    ax.axhline(100 * NEAR, color=MUTED, lw=0.8, ls="--")
    ax.set(xlabel="step of the sampler", ylabel="from the dance (cm)")
    ax.set(ylim=(0, None), xlim=(0.5, len(away) + 0.5))
    there = next(k for k in range(len(away)) if max(away[k:]) < NEAR) + 1
    set_title(ax, f"From step {there} of {len(away)} on, the guess is within 5 cm of the dance")
    return figure, dance, song


def swap_panel(model, song, *, swap="102", report=None, **options):
    """Ask for a new order from left to right, such as "201", and see who goes where.

    ``swap``: who stands where in the end, counted from 0 on the left at the start; ``start``, if
    given: a place (x, z) in metres for each dancer -> Figure, Motion, song.
    """
    order = [int(k) for k in swap]
    options = {"seconds": SHORT["seconds"], "dancers": len(order), "swap": order} | options
    dance = model.generate(song, **options, progress=report or False)
    figure = new_figure(8.2, 3.2)
    floor, lanes = figure.subplots(1, 2, width_ratios=[1, 1.3])
    plot_floor_paths(dance, ax=floor, title=farthest(dance))
    found = final_order(dance.root)
    said = "They obey" if list(found) == order else "They do not obey"
    plot_lanes(dance, ax=lanes, title=f"{said}: asked {swap}, got {''.join(map(str, found))}")
    return figure, dance, song


def long_panel(model, song, *, report=None, **options):
    """A dance of segments, and how far anybody goes in one frame -> Figure, Motion, song."""
    options = SHORT | {"seconds": 12.0, "dancers": 2} | options
    dance = model.generate(song, **options, progress=report or False)
    time = np.arange(dance.num_frames) / dance.fps
    step = 100 * dance.joints().diff(dim=1).norm(dim=-1).amax((0, 2)).numpy()
    figure = new_figure(8.2, 3.6)
    lanes, steps_ax = figure.subplots(2, 1, sharex=True)
    plot_lanes(dance, ax=lanes)
    lanes.set_xlabel("")
    steps_ax.plot(time[1:], step, color=INK, lw=1)
    for ax in (lanes, steps_ax):
        for at in dance.meta["seams"]:
            ax.axvline(at / dance.fps, color=MUTED, lw=1, ls="--")
    bare(steps_ax).set(xlabel="time (s), seams dashed", ylabel="largest move (cm)", ylim=(0, None))
    at_seams = [seam - 1 for seam in dance.meta["seams"]]
    if at_seams:
        found = (
            f"largest move at a seam {step[at_seams].max():.1f} cm, anywhere {step.max():.1f} cm"
        )
    else:
        found = "one segment, no seam"
    set_title(lanes, f"overlap {dance.meta['overlap']}, {dance.meta['pinning']}: {found}")
    return figure, dance, song


def cue_panel(model, song, *, report=None, **options):
    """A Lodge dance, its cues, and in which steps they are held -> Figure, Motion, song."""
    from matplotlib.colors import ListedColormap

    options = {"seconds": 17.0, "steps": 15} | options
    dance = model.generate(song, **options, progress=report or False)
    made = dance.meta
    hard, soft_frames = cue_frames(
        model, song, dance.num_frames, made["mirror"], made["beat_align"]
    )
    times = sampling_times(made["sampler"], made["steps"], model.model.abar, made["sigma_min"])
    held = guided_steps(times, made["soft"])
    ribbon = np.zeros((len(times) - 1, dance.num_frames))
    ribbon[:held, soft_frames] = 1
    ribbon[:, hard] = 2
    figure = new_figure(8.2, 3.8)
    energy, cues = figure.subplots(2, 1, sharex=True, height_ratios=[1.3, 1])
    beats = song.beats()
    plot_energy(dance, ax=energy, beats=beats, seams=dance.meta["seams"])
    colors = ListedColormap([PAPER, *(mix(PAPER, kind, SHADE[kind]) for kind in (SOFT, HARD))])
    extent = (0, dance.duration, len(times) - 0.5, 0.5)
    look = {"aspect": "auto", "interpolation": "nearest"}
    cues.imshow(ribbon, cmap=colors, vmin=0, vmax=2, extent=extent, **look)
    bare(cues).set(xlabel="time (s)", ylabel="step of the sampler")
    energy.set_xlabel("")
    score = beat_alignment(dance.joints(), beats[beats < dance.duration], direction="music")
    set_title(energy, f"{made['genre']}, s = {made['soft']:g}: BAS {score:.2f}")
    steps = f"{held} of {len(times) - 1} steps"
    set_title(cues, f"Soft cues (light) are held in {steps}, hard ones (dark) in all")
    return figure, dance, song


def cue_frames(
    model, song, frames: int, mirror: bool, beat_align: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Which frames of a dance lie under hard and under soft cues, two bool (f,)."""
    layout = model.config.global_stage.layout
    segments = segments_of(frames, layout)
    empty = torch.zeros(len(segments.globals), layout.num_primitives, layout.length, LODGE.dim)
    beats = dance_frames(song.features()) if beat_align else ()
    cues = arrange(empty, segments, beats=beats, mirror=mirror).cues()
    whole = np.zeros((2, segments.locals[-1] + layout.local_frames), bool)
    for start, *masks in zip(segments.locals, cues.hard, cues.soft, strict=True):
        for row, mask in zip(whole, masks, strict=True):
            row[start : start + len(mask)] |= mask.numpy()
    return whole[0, :frames], whole[1, :frames]
