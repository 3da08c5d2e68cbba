"""How good the averaged model is on dances that it does not learn from."""

from collections.abc import Callable
from pathlib import Path

import torch
from torch import nn

from dancediff.nn.dance_network import NormalizedNetwork
from dancediff.training.checkpoint import read_facts, save_average
from dancediff.training.config import TrainConfig
from dancediff.training.objective import BatchLosses
from dancediff.training.validation_metrics import ValidationMetrics

BEST = "best.safetensors"
BATCHES = 8  # that the validation loss is a mean of


class Evaluator:
    """The loss on fixed windows of the validation split, and previews.

    Every ``config.evaluate_every`` steps the averaged model is evaluated on the same
    `BATCHES` batches of ``data`` with the same noise; the best one so far is kept
    in the folder as ``best.safetensors``. Every ``config.preview_every`` steps
    ``preview(model, step)`` is called; every ``config.metrics_every`` steps ``metrics``, if there
    are any, score its dances.
    """

    def __init__(
        self,
        data,
        config: TrainConfig,
        preview: Callable | None = None,
        metrics: ValidationMetrics | None = None,
    ):
        self.data, self.config, self.preview, self.metrics = data, config, preview, metrics

    @property
    def evaluates(self) -> bool:
        """Will there be a validation loss at all?"""
        return self.data is not None and self.config.evaluate_every > 0

    @torch.no_grad()
    def validation_loss(self, model: NormalizedNetwork, objective: BatchLosses) -> float:
        """The mean of "total" over the fixed batches."""
        losses = [objective.losses(model, self.data.batch(k), k)["total"] for k in range(BATCHES)]
        return torch.stack(losses).mean().item()

    def keep_best(self, model: nn.Module, loss: float, step: int, folder: Path) -> None:
        """Write the model if none before had a smaller loss."""
        path = folder / BEST
        if path.exists() and read_facts(path)["validation"] <= loss:
            return
        save_average(path, model, {"step": step, "validation": loss})

    def due(self, step: int, every: int) -> bool:
        """Is it time after ``step`` steps?"""
        return every > 0 and step % every == 0
