"""Models that are trained in stages: the settings of each, and what a stage left out keeps."""

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from torch import nn

from dancediff.training.checkpoint import NAME, load_average
from dancediff.training.config import TrainConfig
from dancediff.training.evaluator import forget
from dancediff.training.trainer import Trainer

Network = TypeVar("Network", bound=nn.Module)


@dataclass(frozen=True)
class StageConfig(TrainConfig):
    """A table of settings, in which ``steps = 0`` leaves a stage out.

    Raises: ValueError naming the key, its value and what is allowed; what two keys must be
    together is known of the tables together only, see `check_stages`.
    """

    def __post_init__(self):
        if self.metrics_every:
            raise ValueError(
                f"metrics_every={self.metrics_every} is for models of one stage; leave it out"
            )
        if self.steps != 0:  # evaluate_every, which patience needs, may stand in another table
            TrainConfig(**vars(self) | {"evaluate_every": self.evaluate_every or 1})


def stage_settings(tables: dict, stage: str, **more) -> TrainConfig | None:
    """How a stage is trained; None for ``steps = 0``.  ``more``: fields that no table has.

    >>> tables = {"train": {"steps": 5}, "train_local": {"steps": 7}, "train_global": {"steps": 0}}
    >>> stage_settings(tables, "local").steps, stage_settings(tables, "global")
    (7, None)
    """
    settings = tables["train"] | tables[f"train_{stage}"]
    return None if settings.get("steps") == 0 else TrainConfig(**settings, **more)


def check_stages(tables: dict, stages: Iterable[str], source: str) -> None:
    """Do the settings of every stage, those of [train] with what differs, fit together?

    Raises: ValueError naming the source, the table of the stage and the key that does not fit.
    """
    for stage in stages:
        if "seed" in tables[f"train_{stage}"]:
            raise ValueError(f"{source}: 'train_{stage}': seed is that of 'train', for all stages")
        try:
            stage_settings(tables, stage)
        except ValueError as err:
            raise ValueError(f"{source}: 'train_{stage}': {err}") from err


def kept_of(network: Network, folder: Path) -> Network:
    """The averaged network of a stage that was trained before, as it is where there is none."""
    kept = folder / NAME
    return load_average(kept, network) if kept.exists() else network


def later_folders(out: Path, stage: str, settings: dict[str, TrainConfig | None]) -> list[Path]:
    """Folders of the stages after ``stage`` that are trained, too.

    >>> settings = {"local": TrainConfig(), "fine_tune": TrainConfig()}
    >>> [folder.name for folder in later_folders(Path("run"), "local", settings)]
    ['fine_tune']
    """
    names = list(settings)
    return [out / name for name in names[names.index(stage) + 1 :] if settings[name] is not None]


def make_way(trainer: Trainer, later: Iterable[Path], *, overwrite: bool = False) -> None:
    """Before a stage learns more, remove what ``later`` stages made of what it had learned before.

    Else they would be taken as done, and what it learns now would be thrown away.

    Warns: of the folders, unless the whole training is to be overwritten.
    """
    if not trainer.left or not trainer.world.first:
        return
    old = [folder for folder in later if (folder / NAME).exists()]
    for folder in old:
        (folder / NAME).unlink()
        forget(folder)
    if old and not overwrite:
        names = ", ".join(map(str, old))
        text = f"a stage before learns more, so what is in {names} is trained anew"
        warnings.warn(text, stacklevel=4)
