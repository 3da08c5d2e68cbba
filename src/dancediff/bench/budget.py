r"""Trainings with a budget of computing or of windows, and branches that leave them.

Read first: `dancediff.training.trainer`.

One run goes on at a constant learning rate. A branch leaves it when four fifths of a budget are
spent, and lets the rate fall to zero over the rest: a branch is what a training of just that budget
would be (Hägele et al. 2024). Budgets are minutes of processor time of all threads, so what else
the machine does changes nothing, or numbers of dancer windows. A run that was stopped goes on from
its checkpoint.

Symbols (axes: b windows · n dancers)
    spent    processor time of a training, seconds
    windows  dancer windows that were learned from, b n a step
"""

import json
import math
import shutil
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm.auto import tqdm

from dancediff import hub
from dancediff.atomic import write_toml
from dancediff.training.checkpoint import NAME
from dancediff.training.run import train_from_config
from dancediff.training.tables import read_training
from dancediff.training.trainer import Trainer

FOREVER = 10**7  # steps of the run that branches leave
STABLE = 0.8  # share of a budget at the constant rate
UNITS = ("min", "windows")  # of a budget
NO_EVALUATION = {"evaluate_every": 0, "metrics_every": 0, "patience": 0}  # it would be paid for


class Counted:
    """Windows that count how many dancers they handed out."""

    def __init__(self, data):
        self.data, self.windows = data, 0

    def batch(self, number: int):
        """As the data has it."""
        batch = self.data.batch(number)
        self.windows += math.prod(batch[0].shape[:-2])  # (b, n, f, d), or (b, f, d) of solos
        return batch


class BudgetTrainer(Trainer):
    """A trainer that knows what it has spent, also after a pause.

    ``spent.jsonl`` beside the checkpoint holds a line for every step that has had one: what was
    spent until then. It is written before the checkpoint.
    """

    bar: tqdm | None = None
    unit = "min"

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        if self.out is None:
            raise ValueError("out=None: a training with a budget needs a folder for what it spent")
        self.data = Counted(self.data)
        self.spent, self.data.windows = spent_until(self.out, self.first)

    @property
    def so_far(self) -> float:
        """What is used of the budget, in its unit."""
        return used({"spent": self.spent, "windows": self.data.windows}, self.unit)

    def step(self, step: int) -> dict[str, float]:
        """As any trainer, timed."""
        began = time.process_time()
        row = super().step(step)
        self.spent += time.process_time() - began
        if self.bar is not None and self.config.steps == FOREVER:
            minutes = f"{self.spent / 60:.1f} min of computing"
            self.bar.set_description(f"training, {minutes}", refresh=False)
        return row

    def _steps(self) -> tqdm:
        """As any trainer; while only the budget is known, the bar has no end."""
        self.bar = super()._steps()
        return self.bar

    def _total(self) -> float:
        return np.inf if self.config.steps == FOREVER else self.config.steps

    def _save(self, step: int, logger, signals) -> None:
        due = self.is_due(step)
        if due or signals.stop or signals.save:
            line = json.dumps({"step": step, "spent": self.spent, "windows": self.data.windows})
            assert self.out is not None
            with (self.out / "spent.jsonl").open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        super()._save(step, logger, signals)


class StableTrainer(BudgetTrainer):
    """Stops, with a checkpoint, as soon as ``until`` of its ``unit`` are used."""

    until = np.inf

    def _save(self, step: int, logger, signals) -> None:
        enough = self.so_far >= self.until
        signals.save = signals.save or enough
        super()._save(step, logger, signals)
        if enough:
            raise EnoughError


class EnoughError(Exception):
    """A training has used what it was given."""


def used(line: dict, unit: str) -> float:
    """Minutes or dancer windows, of a line of ``spent.jsonl``.

    >>> line = {"step": 10, "spent": 90.0, "windows": 160}
    >>> used(line, "min"), used(line, "windows")
    (1.5, 160)
    """
    return line["spent"] / 60 if unit == "min" else line["windows"]


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
    """A training config with other values in its table ``train``, in which nothing is evaluated."""
    tables = read_training(source)
    for name in tables:
        if name == "train" or name.startswith("train_"):  # the latter are those of stages
            tables[name] |= NO_EVALUATION
    tables["train"] |= train
    write_toml(path, tables)
    return path


@dataclass(frozen=True)
class Run:
    """A training with one seed, and the branches that leave it; budgets are in one of `UNITS`."""

    config: Path
    seed: int
    folder: Path
    data: Path | None
    takes: list | None = None
    unit: str = "min"

    def models(self, budgets: tuple[float, ...]) -> Iterator[tuple[float, Path]]:
        """Every budget and the folder of its model, trained if it is not there."""
        for budget in sorted(budgets):
            branch = self.folder / f"{budget:g}{self.unit}"
            if not (branch / "model" / "config.json").exists():
                if not (branch / NAME).exists():
                    self.stable(STABLE * budget)
                    self.leave(branch)
                self.anneal(branch)
            yield budget, branch

    def train(self, config: Path, out: Path, trainer: type[Trainer]):
        """Go on, or begin; other settings than those before are meant."""
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*written with other settings.*")
            return train_from_config(
                config, out, trainer=trainer, takes=self.takes, data=self.data, resume=True
            )

    def stable(self, amount: float) -> None:
        """Train at the constant rate until so much is used.

        Raises: ValueError when more is used already: budgets are trained in rising order.
        """
        path = self.folder / "stable.toml"
        begun = (self.folder / NAME).exists()
        if begun and used(last_line(self.folder), self.unit) > 1.1 * amount:
            raise ValueError(
                f"{str(self.folder)!r} has trained for longer than {amount:g} {self.unit}; a "
                "shorter budget needs a folder of its own (--out)"
            )
        write_config(path, self.config, seed=self.seed, steps=FOREVER, decay=0.0)

        class Until(StableTrainer):
            until, unit = amount, self.unit

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
            changed = steps_left(last_line(branch)["step"])
            write_config(left, self.config, seed=self.seed, **changed)
        model = self.train(left, branch, BudgetTrainer)
        hub.save_model(model, branch / "model", card="A branch of a training with a budget.\n")


def steps_left(done: int) -> dict[str, Any]:
    """How a training ends after so many steps at the constant rate.

    >>> steps_left(8)
    {'steps': 10, 'decay': 0.2}
    """
    more = max(1, round(done * (1 - STABLE) / STABLE))
    return {"steps": done + more, "decay": more / (done + more)}


def last_line(folder: Path) -> dict:
    """What a training has spent so far."""
    lines = (folder / "spent.jsonl").read_text(encoding="utf-8").splitlines()
    return json.loads(lines[-1])
