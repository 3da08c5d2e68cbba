"""Pictures of numbers: music features, a dance as features, the noise schedule, the skeleton.

Read first: `dancediff.viz.style`.
"""

import numpy as np
import torch

from dancediff.axes import FPS
from dancediff.motion.representation import TCDIFFPP
from dancediff.motion.skeleton import SMPL24, forward_kinematics
from dancediff.music.features import BEATS, CHROMA, MFCC, ONSET, PEAKS, beat_times
from dancediff.music.song import needed_song
from dancediff.viz.palette import BEAT, INK, MUTED, dancer_color, ink_on, mix
from dancediff.viz.style import bare, new_axes, set_title

_PITCHES = ("C", "C♯", "D", "D♯", "E", "F", "F♯", "G", "G♯", "A", "A♯", "B")
_DIVERGING = "RdBu_r"
_SEQUENTIAL = "cividis"  # made for colour-blind readers, and monotone in greyscale


def plot_features(M, *, song=None, ax=None, title: str | None = None):
    """The 35 music features over time, in their four groups, under the waveform if a song is given.

    Shapes: M (f, 35), raw, at 30 frames a second -> the Axes; each group has a panel inside it.
    """
    M = np.asarray(M)
    heights = [0.7] * (song is not None) + [0.8, 1.5, 1.2]
    ax = new_axes(ax, (7.6, 1.35 * sum(heights)))
    ax.axis("off")
    panels = _stacked_panels(ax, heights)
    if song is not None:
        plot_waveform(song, ax=panels[0], stop=len(M) / FPS)
    onset, mfcc, chroma = panels[-3:]
    _draw_onset(onset, M)
    z = (M[:, MFCC] - M[:, MFCC].mean(0)) / np.maximum(M[:, MFCC].std(0), 1e-3)
    look = {"aspect": "auto", "origin": "lower"}
    across = (0, len(M) / FPS)
    mfcc.imshow(z.T, extent=(*across, -0.5, 19.5), cmap=_DIVERGING, vmin=-2.5, vmax=2.5, **look)
    mfcc.set_ylabel("MFCC\n[1:21]")
    chroma.imshow(M[:, CHROMA].T, extent=(*across, -0.5, 11.5), cmap=_SEQUENTIAL, **look)
    chroma.set_yticks(range(0, 12, 2), _PITCHES[::2])
    chroma.set(ylabel="chroma\n[21:33]", xlabel="time (s)")
    for panel in panels:
        bare(panel, keep=("bottom",)).set_xlim(*across)
        panel.tick_params(labelbottom=panel is chroma)
        panel.yaxis.set_label_coords(-0.05, 0.5)  # one under the other
    return set_title(ax, title)


def _stacked_panels(ax, heights) -> list:
    """Axes inside an Axes, from the top down, with a little space between them."""
    gap = 0.04
    unit = (1 - gap * (len(heights) - 1)) / sum(heights)
    panels, top = [], 1.0
    for height in heights:
        panels.append(ax.inset_axes([0, max(top - height * unit, 0), 1, height * unit]))
        top -= height * unit + gap
    return panels


def _draw_onset(ax, M: np.ndarray) -> None:
    """Onset strength as a hill, its peaks as marks above, the beats as lines."""
    ax.fill_between(np.arange(len(M)) / FPS, M[:, ONSET.start], color=dancer_color(0), alpha=0.75,
                    lw=0)  # fmt: skip
    top = float(M[:, ONSET.start].max()) or 1.0  # also of silence
    peaks = np.flatnonzero(M[:, PEAKS.start] > 0.5)
    ax.plot(peaks / FPS, np.full(len(peaks), 1.08 * top), "v", ms=3, color=MUTED)
    for beat in np.flatnonzero(M[:, BEATS.start] > 0.5) / FPS:
        ax.axvline(beat, color=BEAT, lw=1, alpha=0.8)
    ax.set(ylim=(0, 1.2 * top), ylabel="onset [0]\npeaks [33]\nbeats [34]")


def plot_waveform(song, *, ax=None, start: float = 0.0, stop: float | None = None, title=None):
    """The sound of a `Music` or a path: largest and smallest sample of each short stretch."""
    ax = new_axes(ax, (7.6, 1.2))
    song = needed_song(song)
    part = song.slice(start, min(stop or song.duration, song.duration)).audio.mean(1)
    columns = np.array_split(part, min(1200, len(part)))
    low, high = ([fn(c) for c in columns] for fn in (np.min, np.max))
    time = start + np.linspace(0, len(part) / song.rate, len(columns))
    ax.fill_between(time, low, high, color=INK, alpha=0.8, lw=0)
    ax.set_ylabel("sound")
    ax.set_yticks([])
    return set_title(bare(ax, keep=("bottom",)), title)


def plot_beats(M, beats=None, *, truth=None, ax=None, title: str | None = None):
    """The onset envelope with detected beats (full lines) and, if known, the true ones (dots).

    Shapes: M (f, 35) raw; beats, truth (k,) seconds; beats default to when those of column 34
    sound, a little before the envelope's tops -> Axes.
    """
    ax = new_axes(ax, (7.6, 2.2))
    M = np.asarray(M)
    beats = beat_times(torch.as_tensor(M)) if beats is None else np.asarray(beats)
    onset = M[:, ONSET.start]
    top = float(onset.max()) or 1.0  # also of silence
    ax.fill_between(np.arange(len(M)) / FPS, onset, color=dancer_color(0), alpha=0.7, lw=0)
    ax.vlines(beats, 0, 1.1 * top, color=BEAT, lw=1.2, label="detected beat")
    if truth is not None:
        ax.plot(truth, np.full(len(truth), 1.18 * top), "o", ms=4, color=INK, label="true beat")
    ax.set(xlim=(0, len(M) / FPS), ylim=(0, 1.28 * top), xlabel="time (s)", ylabel="onset strength")
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1), fontsize=8, frameon=False, ncols=2)
    return set_title(bare(ax), title)


def plot_barcode(x, *, ax=None, title: str | None = None):
    """A dance as features: one row a feature, one column a frame.

    Shapes: x (f, 151) of one dancer, any scale -> Axes. Each row is scaled by its own range, so
    that a row without change is pale throughout.
    """
    ax = new_axes(ax, (7.6, 3.4))
    x = np.asarray(torch.as_tensor(x).detach().float().cpu())  # a guess still has its graph
    low, high = x.min(0), x.max(0)
    scaled = np.where(high - low > 1e-6, (x - low) / np.maximum(high - low, 1e-6) * 2 - 1, 0)
    stop = len(x) / FPS
    ax.imshow(
        scaled.T, aspect="auto", extent=(0, stop, x.shape[1], 0), cmap=_DIVERGING, vmin=-1.4,
        vmax=1.4, interpolation="nearest",
    )  # fmt: skip
    parts = {"contact": TCDIFFPP.contact, "root": TCDIFFPP.root, "24 rotations": TCDIFFPP.rot6d}
    for part in parts.values():
        ax.axhline(part.stop, color=INK, lw=0.8)
    ax.set_yticks(
        [(p.start + p.stop) / 2 for p in parts.values()],
        [f"{name}\n[{p.start}:{p.stop}]" for name, p in parts.items()],
    )
    ax.set(xlabel="time (s)")
    # the two narrow bands would write over each other
    for label, shift in zip(ax.get_yticklabels(), ("bottom", "top", "center"), strict=True):
        label.set_verticalalignment(shift)
    return set_title(bare(ax, keep=()), title)


def plot_schedule(abar, *, t=None, ax=None, title: str | None = None):
    r"""How much signal, $\sqrt{\bar\alpha_t}$, and noise, $\sqrt{1-\bar\alpha_t}$, is in $x_t$.

    Shapes: abar (T,); ``t`` marks one step -> Axes.
    """
    ax = new_axes(ax, (6.4, 2.6))
    abar = np.asarray(abar, dtype=np.float64)
    steps = np.arange(len(abar))
    ax.plot(steps, np.sqrt(abar), color=dancer_color(0), lw=2.2)
    ax.plot(steps, np.sqrt(1 - abar), color=dancer_color(4), lw=2.2, ls="--")
    end = len(abar) - 1
    for at, height, name, k in ((0.36, 0.93, "signal  √ᾱ", 0), (0.28, 0.34, "noise  √(1−ᾱ)", 4)):
        ax.text(
            at * end, height, name, color=dancer_color(k), fontsize=9, fontweight="bold",
            zorder=4, bbox={"facecolor": ax.get_facecolor(), "edgecolor": "none", "pad": 1},
        )  # fmt: skip
    if t is not None:
        ax.axvline(t, color=INK, lw=1)
        weights = [abar[t] ** 0.5, (1 - abar[t]) ** 0.5]
        ax.plot([t, t], weights, "o", color=INK, ms=5, clip_on=False)
    ax.set(xlim=(0, end), ylim=(0, 1.05), xlabel="noise level t", ylabel="weight")
    return set_title(bare(ax), title)


def plot_skeleton(*, ax=None, title: str | None = None):
    """The SMPL-24 joint tree from the front, with the index of every joint.

    It stands in the T-pose and faces you, so the left side of the body (blue) is on the right of
    the picture. Returns the Axes.
    """
    ax = new_axes(ax, (6.2, 6.0))
    joints = forward_kinematics(torch.eye(3).expand(24, 3, 3), torch.zeros(3))
    xy = np.asarray(joints)[:, :2]
    side = {"l": dancer_color(0), "r": dancer_color(4)}
    colors = [INK if n[0] not in side or n in ("root",) else side[n[0]] for n in SMPL24.names]
    for parent, child in SMPL24.bones:
        ax.plot(*xy[[parent, child]].T, color=mix(colors[child], "#FFFFFF", 0.45), lw=5, zorder=1)
    ax.scatter(*xy.T, s=170, color=colors, edgecolor="white", zorder=2)
    look = {"fontsize": 8, "fontweight": "bold", "zorder": 3}
    for j, (spot, color) in enumerate(zip(xy, colors, strict=True)):
        ax.annotate(str(j), spot, ha="center", va="center", color=ink_on(color), **look)
    ax.set_aspect("equal")
    ax.margins(0.08)
    ax.set(xlabel="x (m), the dancer's left is +", ylabel="y (m)")
    return set_title(bare(ax), title)
