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
dances windows of held-out takes as a bare network: no rule, no hook, no guidance but autoguidance,
whose strength is searched for each on other songs. Budgets are minutes of processor time of all
threads, so what else the machine does changes nothing.

Everything is kept in --out, and a run that was stopped goes on: trainings from their checkpoints,
dances with the next one. The points go to docs/results/scaling.json and a figure.

Symbols (axes: b windows · n dancers · f frames)
    spent    processor time of a training, seconds
    windows  dancer windows that were learned from, b n a step
"""

import itertools
import json
import shutil
import time
import tomllib
import warnings
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path

import joblib
import matplotlib.pyplot as plt
import numpy as np
import torch
import tyro
from bars import Sampling, Window, chosen, dance, windows
from tqdm.auto import tqdm

from dancediff import hub
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.metrics.dances import find_dances
from dancediff.metrics.measure import Measured
from dancediff.metrics.measure_all import measure_all
from dancediff.metrics.rows import table_rows
from dancediff.metrics.swaps import obeys
from dancediff.motion.motion import Motion
from dancediff.training.checkpoint import NAME
from dancediff.training.run import train_from_config
from dancediff.training.trainer import Trainer
from dancediff.viz.palette import DANCER_COLORS
from dancediff.viz.style import bare

FOREVER = 10**7  # steps of the run that branches leave
STABLE = 0.8  # share of a budget at the constant rate
METRICS = (
    *("FID_k", "FID_g", "GMR", "GMC", "TIF", "Div_k", "Div_g", "MMC", "FSR", "PFC"),
    *("joint speed", "orders kept"),
)
BARE = Sampling(
    guidance=1.0,
    foot_contact=False,
    collision_avoidance=False,
    order_constraint=False,
    frequency_clip=False,
)


class Counted:
    """Windows that count how many dancers they handed out."""

    def __init__(self, data):
        self.data, self.windows = data, 0

    def batch(self, number: int):
        """As the data has it."""
        batch = self.data.batch(number)
        self.windows += batch[0].shape[0] * batch[0].shape[1]
        return batch


class BudgetTrainer(Trainer):
    """A trainer that knows what it has spent, also after a pause.

    ``spent.jsonl`` beside the checkpoint holds a line for every step that has had one: what was
    spent until then. It is written before the checkpoint.
    """

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        self.data = Counted(self.data)
        self.spent, self.data.windows = spent_until(self.out, self.first)

    def step(self, step: int) -> dict[str, float]:
        """As any trainer, timed."""
        began = time.process_time()
        row = super().step(step)
        self.spent += time.process_time() - began
        return row

    def _save(self, step: int, logger, signals) -> None:
        due = step % self.config.save_every == 0 or step == self.config.steps
        if due or signals.stop or signals.save:
            line = json.dumps({"step": step, "spent": self.spent, "windows": self.data.windows})
            with (self.out / "spent.jsonl").open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        super()._save(step, logger, signals)


class StableTrainer(BudgetTrainer):
    """Stops, with a checkpoint, as soon as ``until`` seconds are spent."""

    until = np.inf

    def _save(self, step: int, logger, signals) -> None:
        enough = self.spent >= self.until
        signals.save = signals.save or enough
        super()._save(step, logger, signals)
        if enough:
            raise EnoughError


class EnoughError(Exception):
    """A training has spent what it was given."""


def spent_until(folder: Path, step: int) -> tuple[float, int]:
    """Seconds and dancer windows of a training's first steps.

    Raises: ValueError where a checkpoint lies that no `BudgetTrainer` wrote.
    """
    if step == 0:
        return 0.0, 0
    path = folder / "spent.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    rows = [row for row in map(json.loads, lines) if row["step"] == step]
    if not rows:
        raise ValueError(f"{str(path)!r} does not say what the first {step} steps took; start anew")
    return rows[-1]["spent"], rows[-1]["windows"]


def write_config(path: Path, source: Path, **train) -> Path:
    """A training config with other values in its table ``train``."""
    tables = tomllib.loads(source.read_text(encoding="utf-8"))
    tables["train"] = tables.get("train", {}) | {"evaluate_every": 0} | train
    lines = []
    for name, values in tables.items():
        lines += [f"[{name}]", *(f"{key} = {json.dumps(value)}" for key, value in values.items())]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@dataclass(frozen=True)
class Run:
    """A training with one seed, and the branches that leave it."""

    config: Path
    seed: int
    folder: Path
    data: Path | None
    takes: list | None = None

    def models(self, minutes: tuple[float, ...]) -> Iterator[tuple[float, Path]]:
        """Every budget and the folder of its model, trained if it is not there."""
        for budget in sorted(minutes):
            branch = self.folder / f"{budget:g}min"
            if not (branch / "model" / "config.json").exists():
                if not (branch / NAME).exists():
                    self.stable(60 * STABLE * budget)
                    self.leave(branch)
                self.anneal(branch)
            yield budget, branch

    def train(self, config: Path, out: Path, trainer: type[Trainer]):
        """Go on, or begin; other settings than those before are meant."""
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*written with other settings.*")
            options = {"takes": self.takes, "data": self.data, "resume": True}
            return train_from_config(config, out, trainer=trainer, **options)

    def stable(self, seconds: float) -> None:
        """Train at the constant rate until so much is spent.

        Raises: ValueError when more is spent already: budgets are trained in rising order.
        """
        path = self.folder / "stable.toml"
        if (self.folder / NAME).exists() and last_line(self.folder)["spent"] > 1.1 * seconds:
            raise ValueError(
                f"{str(self.folder)!r} has trained for longer than {seconds:g} s; a shorter budget "
                "needs a folder of its own (--out)"
            )
        write_config(path, self.config, seed=self.seed, steps=FOREVER, decay=0.0)

        class Until(StableTrainer):
            until = seconds

        try:
            self.train(path, self.folder, Until)
        except EnoughError:
            return

    def leave(self, branch: Path) -> None:
        """Copy the run to where a branch goes on, the checkpoint last."""
        branch.mkdir(parents=True, exist_ok=True)
        for name in ("spent.jsonl", "losses.csv", NAME):
            if (self.folder / name).exists():
                shutil.copyfile(self.folder / name, branch / f"{name}.part")
                (branch / f"{name}.part").replace(branch / name)

    def anneal(self, branch: Path) -> None:
        """Let the learning rate fall to zero over the rest of the budget, and save the model."""
        left = branch / "left.toml"
        if not left.exists():
            done = last_line(branch)["step"]
            more = max(1, round(done * (1 - STABLE) / STABLE))
            changed = {"steps": done + more, "decay": more / (done + more)}
            write_config(left, self.config, seed=self.seed, **changed)
        model = self.train(left, branch, BudgetTrainer)
        hub.save_model(model, branch / "model", card=f"A point of {Path(__file__).name}.\n")


def last_line(folder: Path) -> dict:
    """What a training has spent so far."""
    lines = (folder / "spent.jsonl").read_text(encoding="utf-8").splitlines()
    return json.loads(lines[-1])


def _dance_to(path: Path, model: Path, window: Window, seed: int, sampling: Sampling) -> None:
    torch.set_num_threads(1)
    motion = dance(_loaded(model), window, seed=seed, naive=False, sampling=sampling)
    motion.meta["kind"] = "generated"
    motion.save(path)


def _loaded(folder: Path, _known={}):  # noqa: B006 (one a process; models are small)
    if folder not in _known:
        _known.clear()
        _known[folder] = hub.load(folder)
    return _known[folder]


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
    autoguidance: tuple[float, ...] = (1.0, 1.5, 2.0, 2.5)
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
        draw(points, self.figure)

    def budgets(self, seed: int) -> tuple[float, ...]:
        """Minutes that are trained with a seed."""
        first = seed == self.seeds[0]
        return tuple(m for m in self.minutes if first or m <= self.many_seeds)

    def point(self, name: str, seed: int, budget: float, branch: Path) -> dict:
        """Score a model, or read what was found before."""
        path = branch / "point.json"
        if path.exists():
            return json.loads(path.read_text(encoding="utf-8"))
        strength, searched = self.search(branch)
        found = last_line(branch) | {"config": name, "seed": seed, "minutes": budget}
        found |= {"autoguidance": strength, "searched": searched, "scores": {}}
        for frames in self.frames:
            some = chosen(list(windows(str(self.held), frames, ("synthetic",))), self.count)
            rows, kept = self.scores(branch, some, strength, f"{frames}")
            rows["orders kept"] = [kept, None, None]
            found["scores"][str(frames)] = {m: rows[m] for m in METRICS}
            cells = " | ".join(f"{rows[metric][0]:.3g}" for metric in METRICS)
            print(f"| {name} | {seed} | {budget:g} | {frames} | {strength:g} | {cells} |")
        path.write_text(json.dumps(found) + "\n", encoding="utf-8")
        return found

    def search(self, branch: Path) -> tuple[float, dict]:
        """The strength with the lowest FID_k + GMR on songs that are not of the table."""
        if (
            len(self.autoguidance) == 1
            or preconditioning_of(_loaded(branch / "model").model) is None
        ):
            return 1.0 if len(self.autoguidance) > 1 else self.autoguidance[0], {}
        some = chosen(list(windows(str(self.tuning), 150, ("synthetic",))), self.tuned)
        found = {}
        for strength in self.autoguidance:
            rows, _ = self.scores(branch, some, strength, f"tuning-{strength:g}")
            found[strength] = rows["FID_k"][0] + rows["GMR"][0]
        return min(found, key=found.__getitem__), found

    def scores(
        self, branch: Path, some: list[Window], strength: float, name: str
    ) -> tuple[dict[str, list], float]:
        """Dance the windows again; every metric, and the share that ends in the order asked for."""
        folder = branch / f"dances-{name}"
        folder.mkdir(exist_ok=True)
        files = [folder / f"{window.name}.npz" for window in some]
        sampling = Sampling(**asdict(self.sampling) | {"autoguidance": strength})
        jobs = [
            joblib.delayed(_dance_to)(path, branch / "model", window, seed, sampling)
            for seed, (path, window) in enumerate(zip(files, some, strict=True))
            if not path.exists()
        ]
        if jobs:
            run = joblib.Parallel(min(self.workers, len(jobs)), return_as="generator")
            list(tqdm(run(jobs), total=len(jobs), desc=f"dancing {name}"))
        beats = [window.beats for window in some]
        how = {"window": 150, "workers": self.workers}
        measured, _ = measure_all(list(files), beats, "dances", **how)
        rows = {row.name: row for row in table_rows(measured, self.reference)}
        kept = [
            obeys(Motion.load(path).root, window.orders()[-1])
            for path, window in zip(files, some, strict=True)
        ]
        cells = {name: [row.value, row.low, row.high] for name, row in rows.items()}
        return cells, float(np.mean(kept))

    @cached_property
    def reference(self) -> list[Measured]:
        """What the dances are compared with, measured once."""
        sources = find_dances([self.other])
        none = itertools.repeat(None)
        return measure_all(sources, none, "reference", window=150, workers=self.workers)[0]

    def write(self, points: list[dict]) -> None:
        """The points as a table of the pages: a row each and length."""
        rows = [
            [
                *(p["config"], p["seed"], p["minutes"], round(p["spent"]), p["windows"]),
                *(int(frames), p["autoguidance"]),
                *(rounded(scores[metric]) for metric in METRICS),
            ]
            for p in points
            for frames, scores in p["scores"].items()
        ]
        table = {
            "about": "Quality against computing, bare networks; autoguidance chosen for each on "
            "other songs.",
            "data": "synthetic",
            "intervals": "95 % bootstrap intervals over dances",
            "command": "python benchmarks/scaling.py CONFIGS",
            "columns": ["config", "seed", "minutes", "seconds spent", "dancer windows", "frames",
                        "autoguidance", *METRICS],
            "rows": rows,
        }  # fmt: skip
        self.results.parent.mkdir(parents=True, exist_ok=True)
        self.results.write_text(json.dumps(table, indent=1, ensure_ascii=False) + "\n", "utf-8")


def rounded(cell: list):
    """A value with its interval, or alone; None where there is none."""
    value, *interval = (None if v is None or np.isnan(v) else float(f"{v:.4g}") for v in cell)
    return value if None in (value, *interval) else [value, *interval]


def draw(points: list[dict], path: Path) -> None:
    """A row for each metric and length, against seconds and against dancer windows."""
    lengths = list(points[0]["scores"])
    shape = (len(METRICS), 2 * len(lengths))
    figure, panels = plt.subplots(*shape, figsize=(3.2 * shape[1], 2.0 * shape[0]), squeeze=False)
    axes = [(frames, x) for frames in lengths for x in ("spent", "windows")]
    for row, metric in zip(panels, METRICS, strict=True):
        for panel, (frames, x) in zip(row, axes, strict=True):
            for k, config in enumerate(dict.fromkeys(p["config"] for p in points)):
                line = mean_line([p for p in points if p["config"] == config], metric, frames, x)
                panel.plot(*line, "o-", ms=3, lw=1.2, color=DANCER_COLORS[k], label=config)
            words = "seconds of computing" if x == "spent" else "dancer windows"
            bare(panel).set(xscale="log", xlabel=words)
            panel.set_title(f"{metric}, {frames} frames", loc="left", fontsize=8)
    panels[0, 0].legend(frameon=False, fontsize=7)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def mean_line(points: list[dict], metric: str, frames: str, x: str) -> tuple[list, list]:
    """Means over seeds, budget by budget.

    >>> two = [{"minutes": 1, "spent": s, "scores": {"150": {"GMR": [v, None, None]}}}
    ...        for s, v in ((60, 3.0), (62, 5.0))]
    >>> mean_line(two, "GMR", "150", "spent")
    ([61.0], [4.0])
    """
    budgets = sorted({p["minutes"] for p in points})
    groups = [[p for p in points if p["minutes"] == budget] for budget in budgets]
    where = [float(np.mean([p[x] for p in same])) for same in groups]
    values = [
        float(np.nanmean([np.nan if (v := p["scores"][frames][metric][0]) is None else v
                          for p in same]))
        for same in groups
    ]  # fmt: skip
    return where, values


if __name__ == "__main__":
    tyro.cli(Scaling).run()
