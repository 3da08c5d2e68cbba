"""Where a training is shown beside its CSV: TensorBoard, Weights & Biases.

Read first: `dancediff.training.logger`.
"""

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from dancediff.atomic import write_text

CSV = "csv"  # is always written: a run that goes on and the curves read it


class Board(Protocol):
    """A log of numbers, which others draw."""

    def add(self, step: int, values: dict[str, float]) -> None:
        """Note what was measured in a step."""

    def close(self) -> None:
        """Write what is left."""


class TensorBoard:
    """Event files in ``RUN/tensorboard``; steps that are run again are shown once."""

    def __init__(self, folder: Path, first: int, facts: dict):
        from torch.utils.tensorboard import SummaryWriter

        self.writer = SummaryWriter(folder / "tensorboard", purge_step=first)

    def add(self, step: int, values: dict[str, float]) -> None:
        """One point in each curve."""
        for name, value in values.items():
            self.writer.add_scalar(name, value, step)

    def close(self) -> None:
        """Write what is left."""
        self.writer.close()


class WandB:
    """A run of the project "dancediff", named like the folder; WANDB_MODE=offline keeps it here.

    ``RUN/wandb_run.txt`` holds its id, so that a training which goes on stays one run there.
    """

    def __init__(self, folder: Path, first: int, facts: dict):
        import wandb

        known = folder / "wandb_run.txt"
        name = known.read_text(encoding="utf-8").strip() if first and known.exists() else None
        try:
            self.run = wandb.init(
                project="dancediff",
                name=folder.name,
                id=name,
                resume="allow",
                dir=folder,
                config=facts,
            )
        except wandb.Error as err:
            raise RuntimeError(f"log: wandb cannot begin: {err}; try WANDB_MODE=offline") from err
        write_text(known, f"{self.run.id}\n")

    def add(self, step: int, values: dict[str, float]) -> None:
        """One row."""
        self.run.log(values, step=step)

    def close(self) -> None:
        """Write what is left."""
        self.run.finish()


BOARDS: dict[str, type[TensorBoard] | type[WandB]] = {"tensorboard": TensorBoard, "wandb": WandB}


def check_logs(names: str | Sequence[str]) -> tuple[str, ...]:
    """Names of logs, or a text with commas between them, without the CSV.

    Raises: ValueError for an unknown name, or for one that is not installed.

    >>> check_logs("csv"), check_logs(())
    ((), ())
    >>> check_logs("cvs")
    Traceback (most recent call last):
    ValueError: log 'cvs' is not one of csv, tensorboard, wandb
    """
    if isinstance(names, str):
        names = [name.strip() for name in names.split(",") if name.strip()]
    for name in names:
        if name != CSV and name not in BOARDS:
            raise ValueError(f"log {name!r} is not one of {CSV}, {', '.join(BOARDS)}")
        if name != CSV and not _installed(name):
            raise ValueError(
                f'log {name!r} is not installed: pip install "dancediff[{name}]", or leave it out'
            )
    return tuple(dict.fromkeys(name for name in names if name != CSV))


def _installed(name: str) -> bool:
    spec = importlib.util.find_spec(name)
    return spec is not None and spec.origin is not None  # a folder wandb/ of logs is no module
