"""How good the averaged model is on dances that it does not learn from."""

import math
import shutil
from collections.abc import Callable
from pathlib import Path

import torch
from torch import nn

from dancediff.nn.dance_network import NormalizedNetwork
from dancediff.training.checkpoint import read_facts, save_average
from dancediff.training.config import TrainConfig
from dancediff.training.objective import BatchLosses
from dancediff.training.validation_metrics import METRICS_FILE, ValidationMetrics

BEST = "best.safetensors"
BATCHES = 8  # that the validation loss is a mean of


class Evaluator:
    """The loss on fixed windows of the validation split, and previews.

    Every ``config.evaluate_every`` steps the averaged model is evaluated on the same
    `BATCHES` batches of ``data`` with the same noise; the best one so far is kept
    in the folder as ``best.safetensors``. Every ``config.preview_every`` steps
    ``preview(model, step)`` is called; every ``config.metrics_every`` steps ``metrics``, if there
    are any, score its dances. After ``config.patience`` evaluations in a row without a better one
    the training is to end; the file knows the step of the best, so a run that goes on counts on.
    """

    def __init__(
        self,
        data,
        config: TrainConfig,
        preview: Callable | None = None,
        metrics: ValidationMetrics | None = None,
    ):
        self.data, self.config, self.preview, self.metrics = data, config, preview, metrics
        self.best_step, self.best_loss = 0, math.inf

    @property
    def evaluates(self) -> bool:
        """Will there be a validation loss at all?"""
        return self.data is not None and self.config.evaluate_every > 0

    @torch.no_grad()
    def validation_loss(self, model: NormalizedNetwork, objective: BatchLosses) -> float:
        """The mean of "total" over the fixed batches."""
        losses = [objective.losses(model, self.data.batch(k), k)["total"] for k in range(BATCHES)]
        return torch.stack(losses).mean().item()

    def go_on(self, folder: Path, step: int) -> None:
        """Remember the best model so far that a folder holds; without one count from ``step``.

        Raises: ValueError naming the file when it is none.
        """
        self.best_step = step
        if (path := folder / BEST).exists():
            facts = read_facts(path)
            try:
                self.best_step, self.best_loss = int(facts["step"]), float(facts["validation"])
            except (KeyError, TypeError, ValueError) as err:
                raise ValueError(f"{path} does not say its step and loss: {err}") from err

    def keep_best(self, model: nn.Module, loss: float, step: int, folder: Path | None) -> None:
        """Write the model if none before had as small a loss; a NaN is never the best."""
        if loss < self.best_loss:
            self.best_step, self.best_loss = step, loss
            if folder is not None:
                save_average(folder / BEST, model, {"step": step, "validation": loss})

    def is_enough(self, step: int) -> bool:
        """Has the validation loss not improved for as long as ``patience`` allows?"""
        most = self.config.patience * self.config.evaluate_every
        return self.evaluates and 0 < most <= step - self.best_step


def due(step: int, every: int) -> bool:
    """Is it time after ``step`` steps, where it is time every so many, or never (0)?

    >>> [step for step in range(1, 7) if due(step, every=3)], due(6, every=0)
    ([3, 6], False)
    """
    return every > 0 and step % every == 0


def forget(folder: Path) -> None:
    """Remove what the training before has evaluated and shown: a new one does not replace it."""
    for old in (folder / BEST, folder / METRICS_FILE, *folder.glob("previews/step_*")):
        old.unlink(missing_ok=True)
    shutil.rmtree(folder / Path(BEST).stem, ignore_errors=True)  # `dancediff train` made it of BEST
