r"""Trainings in several stages with one budget.

Read first: `dancediff.bench.budget`.

A stage begins with what the one before has learned, so no branch can leave it: every budget is a
training of its own. Each stage gets that share of the budget which its steps are of all steps in
the config. Four fifths of it are trained at the constant rate, which falls to zero over the rest.
A training that was stopped goes on from its checkpoint.
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from dancediff import hub
from dancediff.atomic import write_text
from dancediff.bench.budget import (
    FOREVER,
    STABLE,
    BudgetTrainer,
    Run,
    last_line,
    steps_left,
    write_config,
)
from dancediff.training.autoregressive import (
    MODELS,
    check_autoregressive_tables,
    is_autoregressive,
)
from dancediff.training.lodge import STAGES, check_lodge_tables, is_lodge
from dancediff.training.run import check_tables
from dancediff.training.tables import read_training

LEFT = "left.json"  # in the folder of a stage: how its rate falls, once that is known


class StageTrainer(BudgetTrainer):
    """A trainer that ends when the ``budgets`` of its stage, the name of its folder, are used."""

    budgets: ClassVar[dict[str, float]]

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        assert self.out is not None
        path = self.out / LEFT
        known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
        self.config = replace(self.config, **known or {"steps": FOREVER, "decay": 0.0})

    def _is_enough(self, step: int) -> bool:
        """Are all steps done? How many there are is known when the rate begins to fall."""
        assert self.out is not None
        stable = STABLE * self.budgets[self.out.name]
        if self.config.steps == FOREVER and step > 0 and self.so_far >= stable:
            left = steps_left(step)
            write_text(self.out / LEFT, json.dumps(left) + "\n")
            self.config = replace(self.config, **left)
        return step >= self.config.steps


class StagedRun(Run):
    """Trainings of a system in stages with one seed, one for each budget."""

    def models(self, budgets: tuple[float, ...]) -> Iterator[tuple[float, Path]]:
        """Every budget and the folder of its model, trained if it is not there."""
        for budget in sorted(budgets):
            branch = self.folder / f"{budget:g}{self.unit}"
            if not (branch / "model" / "config.json").exists():
                self.whole(budget, branch)
            yield budget, branch

    def whole(self, budget: float, branch: Path) -> None:
        """Train all stages in folders of ``branch``, and save the model."""
        shares = stage_shares(read_training(self.config))

        class OfThisBudget(StageTrainer):
            budgets: ClassVar = {stage: budget * share for stage, share in shares.items()}
            unit = self.unit

        path = write_config(branch / "stages.toml", self.config, seed=self.seed)
        model = self.train(path, branch, OfThisBudget)
        stages = [last_line(branch / stage) for stage in shares]
        total = {name: sum(one[name] for one in stages) for name in ("step", "spent", "windows")}
        write_text(branch / "spent.jsonl", json.dumps(total) + "\n")
        hub.save_model(model, branch / "model", card="A training in stages with a budget.\n")


def stages_of(tables: dict) -> tuple[str, ...]:
    """The stages in which a training config trains; none for a system that is trained at once."""
    if is_lodge(tables):
        return tuple(STAGES)
    if is_autoregressive(tables):
        model_class, _ = MODELS[tables["model"]["class"]]
        return model_class.stages
    return ()


def check_config(path: Path) -> None:
    """Refuse a training config that does not fit, before any work is done.

    Raises: ValueError naming the file, the table and the key.
    """
    tables, source = read_training(path), repr(str(path))
    if is_lodge(tables):
        check_lodge_tables(tables, source)
    elif is_autoregressive(tables):
        check_autoregressive_tables(tables, source)
    else:
        check_tables(tables, source)
    try:
        stage_shares(tables)
    except ValueError as err:
        raise ValueError(f"{source}: {err}") from err


def stage_shares(tables: dict) -> dict[str, float]:
    """Which share of the steps each stage has; stages without steps are left out.

    Raises: ValueError where the config does not say how many steps a stage has.

    >>> tables = {"model": {"class": "CoDancers"}, "train": {"steps": 30}}
    >>> stage_shares(tables | {"train_gpt": {"steps": 10}})
    {'units': 0.75, 'gpt': 0.25}
    """
    steps = {}
    for stage in stages_of(tables):
        settings = tables["train"] | tables.get(f"train_{stage}", {})
        if "steps" not in settings:
            raise ValueError(f"steps of the stage {stage!r} are missing; put them in the config")
        steps[stage] = settings["steps"]
    return {stage: n / sum(steps.values()) for stage, n in steps.items() if n > 0}
