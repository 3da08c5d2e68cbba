r"""Quality against computing: what a minute of training buys, for several networks.

    dancediff prepare choreograph 1000 data/all --seconds 30
    dancediff prepare choreograph 400 held --seconds 25 --seed 500000     # songs of the table
    dancediff prepare choreograph 200 tuning --seconds 25 --seed 600000   # for autoguidance only
    dancediff prepare choreograph 400 other --seconds 25 --seed 700000    # the reference
    python benchmarks/scaling.py configs/tcdiffpp_small.toml configs/edge_small.toml \
        --data data/all --held held --tuning tuning --other other

For every config and seed one run goes on at a constant learning rate. A branch leaves it when four
fifths of a budget are spent, and lets the rate fall to zero over the rest: a branch is what a
training of just that budget would be (Hägele et al. 2024). The averaged model of every branch
dances windows of held-out takes as a bare network: no rule, no hook, no guidance but autoguidance.
How strong that is, and whether it goes on to the end, is searched for each on other songs. Budgets
are minutes of processor time of all threads, so what else the machine does changes nothing.

The held-out dances are scored as if a model had made them: what one that dances as they do would
score.

Everything is kept in --out, and a run that was stopped goes on: trainings from their checkpoints,
dances with the next one. Means over seeds go to docs/results/scaling.json, every point to
scaling_points.json beside it, and both to a figure.

Symbols (axes: b windows · n dancers · f frames)
    spent    processor time of a training, seconds
    windows  dancer windows that were learned from, b n a step
"""

import itertools
import json
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import tyro
from bars import Sampling, dance
from kept_dances import only_one_way
from result_table import write_table

from dancediff.atomic import write_text
from dancediff.bench.budget import Run, last_line
from dancediff.bench.held_out import Window, chosen, windows
from dancediff.bench.pictures import draw_quality
from dancediff.bench.scores import danced, loaded, reference_of, scores_of
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.generation.pipeline import Pipeline
from dancediff.metrics.measure import Measured
from dancediff.metrics.swaps import obeys
from dancediff.motion.motion import Motion

METRICS = (
    *("FID_k", "FID_g", "GMR", "unison", "TIF", "Div_k", "Div_g", "MMC", "FSR", "PFC"),
    *("joint speed", "orders kept"),
)
Push = tuple[float, float]  # autoguidance and autoguidance_end
BARE = Sampling(
    guidance=1.0,
    foot_contact=False,
    collision_avoidance=False,
    order_constraint=False,
    frequency_clip=False,
)


def dance_window(model: Pipeline, window: Window, seed: int, *, sampling: Sampling) -> Motion:
    """As the tables of bars.py have it: group models are asked for the window's orders."""
    return dance(model, window, seed=seed, naive=False, sampling=sampling)


@dataclass
class Scaling:
    """Train, dance, score; print a row for every point and write JSON and figure."""

    configs: tyro.conf.Positional[tuple[Path, ...]]
    held: Path
    tuning: Path
    other: Path
    data: Path | None = None  # default: what each config says
    minutes: tuple[float, ...] = (15, 30, 60, 120, 240, 480)
    seeds: tuple[int, ...] = (0, 1, 2)
    many_seeds: float = 60  # minutes up to which all seeds are trained; beyond, the first
    frames: tuple[int, ...] = (150, 720)
    count: int = 200  # windows of every length
    tuned: int = 60  # windows that autoguidance is searched with, of 150 frames
    autoguidance: tuple[float, ...] = (1.0, 1.3, 1.45, 1.6, 1.8, 2.1, 2.4)
    ends: tuple[float, ...] = (0.0, 0.35)  # autoguidance_end
    sampling: Sampling = field(default_factory=lambda: BARE)
    workers: int = 2
    out: Path = Path("runs/scaling")
    results: Path = Path("docs/results/scaling.json")
    figure: Path = Path("docs/images/scaling.png")

    def run(self) -> None:
        """Every point; the table is written anew after each."""
        points = []
        for seed in self.seeds:
            for config in self.configs:
                run = Run(config, seed, self.out / f"{config.stem}-{seed}", self.data)
                for budget, branch in run.models(self.budgets(seed)):
                    points.append(self.point(config.stem, seed, budget, branch))
                    self.write(points)
        draw_quality(points, METRICS, self.figure)

    def budgets(self, seed: int) -> tuple[float, ...]:
        """Minutes that are trained with a seed."""
        first = seed == self.seeds[0]
        return tuple(m for m in self.minutes if first or m <= self.many_seeds)

    def point(self, name: str, seed: int, budget: float, branch: Path) -> dict:
        """Score a model, or read what was found before."""
        path = branch / "scored" / "point.json"
        folders = {k: str(getattr(self, k).resolve()) for k in ("held", "tuning", "other")}
        options = ("frames", "count", "tuned", "autoguidance", "ends", "sampling")
        only_one_way(path.parent, folders | {k: getattr(self, k) for k in options})
        if path.exists():
            return json.loads(path.read_text(encoding="utf-8"))
        (strength, end), searched = self.search(branch)
        found = last_line(branch) | {"config": name, "seed": seed, "minutes": budget}
        found |= {"autoguidance": strength, "end": end, "searched": searched, "scores": {}}
        for frames in self.frames:
            some = self.windows(frames)
            rows, kept = self.scores(branch, some, (strength, end), f"{frames}")
            rows["orders kept"] = [kept, None, None]
            found["scores"][str(frames)] = {m: rows[m] for m in METRICS}
            cells = " | ".join(f"{rows[metric][0]:.3g}" for metric in METRICS)
            print(f"| {name} | {seed} | {budget:g} | {frames} | {strength:g} | {end:g} | {cells} |")
        write_text(path, json.dumps(found) + "\n")
        return found

    def search(self, branch: Path) -> tuple[Push, dict]:
        """The push with the lowest FID_k + GMR on songs that are not of the table."""
        pushes = list(itertools.product(self.autoguidance, self.ends))
        pushes = [push for push in pushes if push[0] > 1 or push[1] == self.ends[0]]
        if preconditioning_of(loaded(branch / "model").model) is None:
            pushes = [(1.0, 0.0)]
        if len(pushes) == 1:
            return pushes[0], {}
        some = chosen(list(windows(str(self.tuning), 150, ("synthetic",))), self.tuned)
        found = {}
        for push in pushes:
            rows, _ = self.scores(branch, some, push, "tuning-{:g}-{:g}".format(*push))
            found[push] = rows["FID_k"][0] + rows["GMR"][0]
        best = min(found, key=found.__getitem__)
        if best[0] == max(self.autoguidance):
            print(f"{branch}: no stronger autoguidance than the best, {best[0]:g}, was tried")
        return best, {"{:g}, {:g}".format(*push): value for push, value in found.items()}

    def scores(
        self, branch: Path, some: list[Window], push: Push, name: str
    ) -> tuple[dict[str, list], float]:
        """Dance the windows again; every metric, and the share that ends in the order asked for."""
        how = {"workers": self.workers}
        strength, end = push
        asked = {"autoguidance": strength, "autoguidance_end": end}
        sampling = Sampling(**asdict(self.sampling) | asked)
        by = partial(dance_window, sampling=sampling)
        files = danced(branch / "scored" / name, branch / "model", some, by, **how)
        kept = [
            obeys(Motion.load(path).root, window.orders()[-1])
            for path, window in zip(files, some, strict=True)
        ]
        return scores_of(files, some, self.reference, **how), float(np.mean(kept))

    def windows(self, frames: int) -> list[Window]:
        """Those of the table."""
        return chosen(list(windows(str(self.held), frames, ("synthetic",))), self.count)

    @cached_property
    def truth(self) -> list[list]:
        """A row for each length of what the held-out dances themselves score."""
        found = []
        for frames in self.frames:
            some = self.windows(frames)
            dances = [window.motion for window in some]
            scores = scores_of(dances, some, self.reference, workers=self.workers)
            scores["orders kept"] = [1.0, None, None]  # they are what was asked for
            found.append(["held-out", None, frames, None, None, *cells_of(scores)])
        return found

    @cached_property
    def reference(self) -> list[Measured]:
        """What the dances are compared with, measured once."""
        return reference_of(self.other, workers=self.workers)

    def write(self, points: list[dict]) -> None:
        """Two tables: a row for every point and length, and for the page the means over seeds."""
        about = (
            "Quality against computing: bare networks, not told the genre; autoguidance, and the "
            "noise down to which it goes, chosen for each on other songs."
        )
        every = {
            "about": f"{about} Every training and budget.",
            "data": "synthetic",
            "intervals": "95 % bootstrap intervals over dances",
            "command": self.command(),
            "columns": ["config", "seed", "minutes", "seconds spent", "dancer windows", "frames",
                        "autoguidance", "to noise", *METRICS],
            "rows": [row for p in points for row in rows_of(p)],
        }  # fmt: skip
        write_table(self.results.with_stem(f"{self.results.stem}_points"), every)
        page = every | {
            "about": f"{about} Means over seeds.",
            "intervals": "smallest and largest of the seeds; held-out: 95 % bootstrap",
            "columns": ["config", "minutes", "frames", "seeds", "dancer windows", *METRICS],
            "rows": over_seeds(points) + self.truth,
        }
        write_table(self.results, page)

    def command(self) -> str:
        """What was called; folders as in the docstring of this file."""
        listed = {"minutes": self.minutes, "seeds": self.seeds, "autoguidance": self.autoguidance}
        listed["ends"] = self.ends
        options = {name: " ".join(f"{v:g}" for v in values) for name, values in listed.items()}
        options |= {"count": self.count, "tuned": self.tuned}
        folders = "--data data/all --held held --tuning tuning --other other"
        return " ".join(
            ["python benchmarks/scaling.py", *map(str, self.configs), folders]
            + [f"--{name} {value}" for name, value in options.items()]
        )


def rows_of(point: dict) -> list[list]:
    """A model's row for each length."""
    head = [point["config"], point["seed"], round(point["minutes"]), round(point["spent"])]
    head += [point["windows"]]
    push = [point["autoguidance"], point["end"]]
    return [
        [*head, int(frames), *push, *cells_of(scores)] for frames, scores in point["scores"].items()
    ]


def cells_of(scores: dict[str, list]) -> list:
    """Every metric of the table, rounded."""
    return [rounded(scores[metric]) for metric in METRICS]


def over_seeds(points: list[dict]) -> list[list]:
    """A row for each config, budget and length: means, beside the smallest and the largest.

    >>> two = [{"config": "a", "minutes": 1.0, "seed": s, "windows": 10 + 2 * s,
    ...         "scores": {"150": {m: [2.0 + s, None, None] for m in METRICS}}} for s in (0, 1)]
    >>> over_seeds(two)[0][:7]
    ['a', 1, 150, 2, 11, [2.5, 2.0, 3.0], [2.5, 2.0, 3.0]]
    """
    rows = []
    for name, minutes in dict.fromkeys((p["config"], p["minutes"]) for p in points):
        same = [p for p in points if (p["config"], p["minutes"]) == (name, minutes)]
        windows = round(np.mean([p["windows"] for p in same]))
        for frames in same[0]["scores"]:
            cells = []
            for metric in METRICS:
                found = [p["scores"][frames][metric][0] for p in same]
                values = [np.nan if value is None else value for value in found]
                ends = [min(values), max(values)] if len(same) > 1 else [None, None]
                cells.append(rounded([np.mean(values), *ends]))
            rows.append([name, round(minutes), int(frames), len(same), windows, *cells])
    return rows


def rounded(cell: list):
    """A value with its interval, or alone; None where there is none."""
    value, *interval = (None if v is None or np.isnan(v) else float(f"{v:.4g}") for v in cell)
    return value if None in (value, *interval) else [value, *interval]


if __name__ == "__main__":
    tyro.cli(Scaling).run()
