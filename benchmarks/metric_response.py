"""How every metric answers to known damage: the figures and tables of docs/metrics_*.md.

    python benchmarks/metric_response.py --out docs/images

Good motion is the choreographer's (synthetic). Five samples of eight trios are damaged by each
corruption in steps; the reference set is another 80 trios. ``--cmu FOLDER`` adds the real takes to
the table, as far as a metric needs neither music nor a requested order nor a reference set.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from pathlib import Path

import numpy as np
import torch
import tyro

from dancediff.data.choreographer import choreograph
from dancediff.data.cmu import cmu_jobs
from dancediff.metrics import corruption
from dancediff.metrics.collision import tif
from dancediff.metrics.fidelity import diversity, fid
from dancediff.metrics.geometric import geometric_features
from dancediff.metrics.group import gmc, gmr, group_features
from dancediff.metrics.kinetic import kinetic_features
from dancediff.metrics.physical import fsr, pfc
from dancediff.metrics.rhythm import beat_alignment
from dancediff.metrics.swaps import abrupt_swaps, final_order, swap_obedience
from dancediff.motion.motion import Motion
from dancediff.viz.palette import DANCER_COLORS, INK, MUTED
from dancediff.viz.style import bare, new_axes, save_figure, set_title

LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0)
CORRUPTIONS = (
    *("freeze", "shuffle_time", "drag_feet", "overlap_dancers", "jitter", "mean_pose"),
    *("shift_beats", "collapse"),
)
DANCERS, SECONDS = 3, 8.0
REFERENCE_SEED = 99
COLORS = dict(zip(CORRUPTIONS, (*DANCER_COLORS, INK, MUTED), strict=True))
ARROW = {1: "↑", -1: "↓"}


@dataclass(frozen=True)
class Sample:
    """Some group dances, the beats of their music in seconds, and the order asked of each."""

    dances: list[Motion]
    beats: list[np.ndarray]
    swaps: list[tuple[int, ...]]

    @cached_property
    def joints(self) -> list[torch.Tensor]:
        """Joint positions of each dance."""
        return [dance.joints() for dance in self.dances]

    @cached_property
    def kinetic(self) -> torch.Tensor:
        """Kinetic features, one row for each dancer."""
        return torch.cat([kinetic_features(joints) for joints in self.joints])

    @cached_property
    def geometric(self) -> torch.Tensor:
        """Geometric features, one row for each dancer."""
        return torch.cat([geometric_features(joints) for joints in self.joints])

    @cached_property
    def group(self) -> torch.Tensor:
        """Group features, one row for each dance."""
        return torch.stack([group_features(joints) for joints in self.joints])

    def mean(self, metric: Callable[..., float]) -> float:
        """Mean of a metric over the dances for which it is defined."""
        values = []
        for joints in self.joints:
            with suppress(ValueError):  # FSR where nobody's foot is on the floor
                values.append(metric(joints))
        return float(np.mean(values)) if values else float("nan")

    def rhythm(self, direction: str) -> float:
        """Mean beat alignment."""
        pairs = zip(self.joints, self.beats, strict=True)
        return float(np.mean([beat_alignment(j, b, direction=direction) for j, b in pairs]))

    def jumps(self) -> float:
        """Mean number of abrupt swaps in a dance."""
        return float(np.mean([len(abrupt_swaps(dance.root)) for dance in self.dances]))

    def obedience(self) -> float:
        """Swap obedience of the dances in which somebody was asked to change places."""
        asked = [k for k, swap in enumerate(self.swaps) if list(swap) != sorted(swap)]
        roots = [self.dances[k].root for k in asked]
        return swap_obedience(roots, [self.swaps[k] for k in asked])["all"]


@dataclass(frozen=True)
class Metric:
    """How a metric is computed, which way is better, what should move it and what fools it."""

    title: str
    better: int  # 1 higher, -1 lower
    measure: Callable[[Sample, Sample], float]  # of a sample and the reference
    moved_by: tuple[str, ...]
    fooled_by: tuple[str, ...] = ()
    log: bool = False  # the figure's axis
    alone: bool = False  # needs neither music nor order nor reference


BODY = ("freeze", "mean_pose", "jitter", "shuffle_time", "drag_feet")
METRICS = {
    "fid_k": Metric("FID_k", -1, lambda s, r: fid(s.kinetic, r.kinetic), BODY, log=True),
    "fid_g": Metric("FID_g", -1, lambda s, r: fid(s.geometric, r.geometric), BODY, log=True),
    "div_k": Metric(
        "Div_k", 1, lambda s, r: diversity(s.kinetic, r.kinetic), ("collapse", *BODY[:2]), BODY[2:]
    ),
    "div_g": Metric(
        "Div_g", 1, lambda s, r: diversity(s.geometric, r.geometric), ("collapse",), BODY
    ),
    "gmr": Metric("GMR", -1, lambda s, r: gmr(s.group, r.group), BODY, log=True),
    "gmc": Metric("GMC", 1, lambda s, r: s.mean(gmc), BODY[:2], BODY[2:], alone=True),
    "tif": Metric("TIF", -1, lambda s, r: s.mean(tif), ("overlap_dancers",), alone=True),
    "bas": Metric("BAS", 1, lambda s, r: s.rhythm("music"), ("shift_beats", *BODY)),
    "mmc": Metric("MMC", 1, lambda s, r: s.rhythm("motion"), ("shift_beats", *BODY[1:]), BODY[:1]),
    "pfc": Metric("PFC", -1, lambda s, r: s.mean(pfc), BODY[2:], BODY[:1], log=True, alone=True),
    "fsr": Metric("FSR", -1, lambda s, r: s.mean(fsr), BODY[1:], BODY[:1], alone=True),
    "abrupt_swaps": Metric(
        "abrupt swaps", -1, lambda s, r: s.jumps(), BODY[2:4], BODY[:1], alone=True
    ),
    "swap_obedience": Metric(
        "swap obedience", 1, lambda s, r: s.obedience(), ("freeze", "shuffle_time")
    ),
}


def make_sample(seed: int, groups: int) -> Sample:
    """Trios of 8 s, each with a tempo of its own; in every fourth the order changes."""
    rng = np.random.default_rng([seed, 4])
    seeds = count(10_000 * seed)
    dances, beats = [], []
    for k in range(groups):
        grid = np.arange(rng.uniform(0, 0.5), SECONDS, 60 / rng.uniform(85, 145))
        while True:
            dance, _ = choreograph(grid, dancers=DANCERS, seed=next(seeds), seconds=SECONDS)
            order = final_order(dance.root)
            if k % 4 < 3 or list(order) != sorted(order):
                break
        dances.append(dance)
        beats.append(grid)
    return Sample(dances, beats, [final_order(dance.root) for dance in dances])


def damaged(sample: Sample, name: str, amount: float, seed: int) -> Sample:
    """The sample after one corruption."""
    rng = np.random.default_rng(seed)
    damage = getattr(corruption, name)
    if name == "shift_beats":
        return replace(sample, beats=[damage(beats, amount, rng) for beats in sample.beats])
    if name == "collapse":
        return replace(sample, dances=damage(sample.dances, amount, rng))
    return replace(sample, dances=[damage(dance, amount, rng) for dance in sample.dances])


def respond(name: str, metrics, samples: list[Sample], reference: Sample, levels=LEVELS) -> dict:
    """Values (levels, seeds) of some metrics under one corruption, by the metric's name."""
    out = {metric: np.zeros((len(levels), len(samples))) for metric in metrics}
    for i, amount in enumerate(levels):
        for seed, sample in enumerate(samples):
            bad = damaged(sample, name, amount, seed)
            for metric in metrics:
                out[metric][i, seed] = METRICS[metric].measure(bad, reference)
    return out


def fails(metric: str, good: np.ndarray, bad: np.ndarray) -> bool:
    """Whether a metric shows clearly that ``bad`` is worse than ``good``, both (seeds,).

    The best of the bad seeds is worse than the worst of the good ones, by more than all the good
    seeds differ among themselves.
    """
    good, bad = METRICS[metric].better * good, METRICS[metric].better * bad
    return bool(bad.max() < good.min() - np.ptp(good))


def draw(name: str, values: dict[str, np.ndarray], folder: Path) -> Path:
    """One metric against the amount of each corruption: mean and range of the seeds."""
    import matplotlib.pyplot as plt

    metric = METRICS[name]
    ax = new_axes(size=(6.4, 3.2))
    for corruption_name in (*metric.moved_by, *metric.fooled_by):
        v = values[corruption_name]
        color = COLORS[corruption_name]
        style = "--" if corruption_name in metric.fooled_by else "-"
        label = corruption_name.replace("_", " ") + (" (fooled)" if style == "--" else "")
        ax.plot(LEVELS, v.mean(1), style, color=color, label=label, marker="o", markersize=3)
        ax.fill_between(LEVELS, v.min(1), v.max(1), color=color, alpha=0.15, linewidth=0)
    if metric.log:
        ax.set_yscale("symlog", linthresh=max(1e-3, values[metric.moved_by[0]][0].mean()))
    bare(ax)
    ax.set_xlabel("amount of the corruption")
    ax.set_ylabel(metric.title)
    set_title(ax, f"{metric.title}: {'higher' if metric.better > 0 else 'lower'} is better")
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False, fontsize=8)
    path = folder / f"metric_{name}.png"
    save_figure(ax.figure, path, dpi=110)
    plt.close(ax.figure)
    return path


def real_takes(folder: Path) -> Sample:
    """The CMU duets, cut to clips of 8 s."""
    length = round(SECONDS * 30)
    takes = [job.make().motion for job in cmu_jobs(folder)]
    clips = [
        take.frames(at, at + length)
        for take in takes
        if take.num_dancers > 1
        for at in range(0, take.num_frames - length + 1, length)
    ]
    return Sample(clips, [], [])


def print_table(values: dict, real: Sample | None) -> None:
    """Every metric on good motion and on each full corruption; * = clearly worse than good."""
    columns = ["good", *CORRUPTIONS, *(["CMU duets"] if real else [])]
    print("| metric | " + " | ".join(c.replace("_", " ") for c in columns) + " |")
    print("| --- |" + " --- |" * len(columns))
    for name in values:
        metric = METRICS[name]
        good = values[name]["freeze"][0]
        cells = [f"{good.mean():.3g} ({good.min():.3g}..{good.max():.3g})"]
        for c in CORRUPTIONS:
            bad = values[name][c][-1]
            cells.append(f"{bad.mean():.3g}{'*' if fails(name, good, bad) else ''}")
        if real:
            cells.append(f"{metric.measure(real, real):.3g}" if metric.alone else "-")
        print(f"| {metric.title} {ARROW[metric.better]} | " + " | ".join(cells) + " |")


@dataclass
class Args:
    """Where to draw, and how much to measure."""

    out: Path = Path("docs/images")
    seeds: int = 5
    groups: int = 8
    reference: int = 80
    cmu: Path | None = None
    metrics: tuple[str, ...] = tuple(METRICS)


def main(args: Args) -> None:
    """Measure everything, draw and print."""
    args.out.mkdir(parents=True, exist_ok=True)  # first: the rest takes minutes
    samples = [make_sample(seed, args.groups) for seed in range(args.seeds)]
    reference = make_sample(REFERENCE_SEED, args.reference)
    values: dict[str, dict] = {name: {} for name in args.metrics}
    for c in CORRUPTIONS:
        for name, v in respond(c, args.metrics, samples, reference).items():
            values[name][c] = v
    for name in args.metrics:
        draw(name, values[name], args.out)
    print_table(values, real_takes(args.cmu) if args.cmu else None)
    print("\nmean over the seeds at amounts " + ", ".join(f"{a:g}" for a in LEVELS))
    for name in args.metrics:
        metric = METRICS[name]
        for c in (*metric.moved_by, *metric.fooled_by):
            means = ", ".join(f"{x:.3g}" for x in values[name][c].mean(1))
            print(f"{metric.title:15} {c:15} {means}")


if __name__ == "__main__":
    main(tyro.cli(Args))
