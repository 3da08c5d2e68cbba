r"""Train a model that makes dances bit by bit, from a TOML file: its stages, one after the other.

Read first: `dancediff.training.run`, which does the same for denoisers ·
`dancediff.autoregression.network`.

Tables of the file
    [data]          where the takes are, and how windows are drawn
    [model]         ``class`` and sizes
    [train]         see TrainConfig, for all stages
    [train_STAGE]   what differs from it; with steps = 0 a stage is not trained, and taken from its
                    folder if it is there
"""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from dancediff.autoregression.network import AutoregressiveNetwork
from dancediff.data.take import DanceTake
from dancediff.data.windows import WindowSampler
from dancediff.extensions.build import NETWORKS, build, check_extensions
from dancediff.nn.quantizer import VectorQuantizer
from dancediff.nn.sizes import check_sizes
from dancediff.training.config import GroupData, TrainConfig
from dancediff.training.distributed import World
from dancediff.training.evaluator import Evaluator
from dancediff.training.folder import check_out, clear_out
from dancediff.training.group_takes import (
    held_out_takes,
    solos_of,
    takes_for,
    tell_other_genres,
    windows_of,
)
from dancediff.training.objective import BatchLosses
from dancediff.training.stages import (
    StageConfig,
    check_stages,
    kept_of,
    later_folders,
    make_way,
    stage_settings,
)
from dancediff.training.statistics import fit_statistics
from dancediff.training.tables import check_all
from dancediff.training.trainer import Trainer, name_of

MODELS = {name: NETWORKS[name] for name in ("FACT", "Bailando", "MNET", "CoDancers")}


class StageObjective(BatchLosses[AutoregressiveNetwork]):
    """The network's own losses in one of its stages."""

    def __init__(self, model: AutoregressiveNetwork, config: TrainConfig, stage: str):
        super().__init__(model, config)
        self.stage = stage

    def losses(self, model: AutoregressiveNetwork, batch, number: int) -> dict[str, Tensor]:
        """See `AutoregressiveNetwork.losses`."""
        g = torch.Generator().manual_seed(self.seed(number))
        with self.same_dropout(number), self.autocast():
            return model.losses(self.to_network(batch), self.stage, g)


def is_autoregressive(tables: dict) -> bool:
    """Are these the tables of a training of such a model?"""
    model = tables.get("model")
    return isinstance(model, dict) and str(model.get("class")) in MODELS


def check_autoregressive_tables(config: dict, source: str) -> dict:
    """All tables of a training config, empty where left out.

    Raises: ValueError naming the source, the table and the key that does not fit.
    """
    check_sizes(config["model"], f"{source}: 'model'")
    names = config["model"].get("extensions", [])
    sizes = {key: value for key, value in config["model"].items() if key != "extensions"}
    tables = check_all(config | {"model": sizes}, known_tables(config), source)
    if not isinstance(names, list | tuple):
        raise ValueError(f"{source}: 'model': extensions={names!r} should be a list of names")
    model_class, config_class = MODELS[sizes["class"]]
    try:
        check_extensions(model_class, config_class(), names)
    except ValueError as err:
        raise ValueError(f"{source}: 'model': {err}") from err
    tables["model"]["extensions"] = list(names)
    check_stages(tables, model_class.stages, source)
    return tables


def known_tables(config: dict) -> dict[str, type]:
    """The dataclass of each table."""
    model_class, config_class = MODELS[config["model"]["class"]]
    stages = {f"train_{stage}": StageConfig for stage in model_class.stages}
    return {"data": GroupData, "model": config_class, "train": StageConfig, **stages}


def train_autoregressive(
    config: dict,
    out,
    *,
    source: str = "config",
    takes: list[DanceTake] | None = None,
    data=None,
    preview: Callable | None = None,
    trainer: type[Trainer] = Trainer,
    **run,
) -> AutoregressiveNetwork:
    """Train all stages in folders of ``out``; returns the averaged model.

    ``data``, else ``folder`` in the config: a prepared folder; else the choreographer's dances.
    ``takes`` replaces what is learned from, not what is evaluated on. Models of solos learn from
    every dancer alone.
    ``preview(model, step)``: in the last stage.  ``trainer``: the class that trains every stage.
    ``run``: ``device``, and as `dancediff.training.trainer.Trainer` has them ``world``, ``resume``,
    ``overwrite`` and ``log``.

    Raises: ValueError for a bad config or folder.
    """
    tables, device = check_autoregressive_tables(config, source), run.pop("device", "cpu")
    world: World | None = run.get("world")
    model_class, config_class = MODELS[tables["model"].pop("class")]
    settings = {stage: stage_settings(tables, stage) for stage in model_class.stages}
    trained = [Path(out) / stage for stage, one in settings.items() if one is not None]
    said = {name: run.get(name) for name in ("resume", "overwrite")}
    check_out(Path(out), model_class, trained, **said)
    extensions = tables["model"].pop("extensions")
    corpus, sizes = GroupData(**tables["data"]), config_class(**tables["model"])
    if takes is None:
        takes = takes_for(corpus, data, sizes)
    evaluates = any(one is not None and one.evaluate_every for one in settings.values())
    held_out = held_out_takes(corpus, data, sizes) if evaluates else []
    if model_class.solo:
        takes, held_out = solos_of(takes), solos_of(held_out)
    takes, known = _of_genres(takes, sizes, tell=True), _of_genres(held_out, sizes)
    if not takes and hasattr(sizes, "genres"):
        raise ValueError(f"no take has one of the genres {', '.join(sizes.genres)}; name others")
    if held_out and not known:
        text = f"no take to evaluate on has one of the genres {', '.join(sizes.genres)}"
        warnings.warn(f"there is no validation: {text}; name others", stacklevel=2)
    torch.manual_seed(tables["train"].get("seed", 0))  # from it layers draw their weights
    model: AutoregressiveNetwork = build(model_class, sizes, extensions)
    if world is not None and world.size > 1 and has_codebook(model):
        raise ValueError(
            f"{type(model).__name__} has a codebook, which each process would learn differently; "
            "train in one process"
        )
    fit_statistics(model, takes, real=corpus.real, mirror=corpus.mirror > 0)
    model.standing = torch.stack([take.x.mean((0, 1)) for take in takes]).mean(0)
    model.to(device if world is None else world.device)
    if run.get("overwrite") and (world is None or world.first):
        clear_out(Path(out), model_class)
    for stage, one in settings.items():
        seed = tables["train"].get("seed", 0)
        windows = windows_of(takes, corpus, model, seed=seed)
        validation = windows_of(known, corpus, model, seed=seed) if known else None
        show = preview if stage == model_class.stages[-1] else None
        options = {"data_name": name_of(takes, tables["data"]), "trainer": trainer, **run}
        options["later"] = later_folders(Path(out), stage, settings)
        model = _trained(model, stage, one, Path(out) / stage, windows, validation, show, options)
    return model.requires_grad_(True).eval()


def _of_genres(takes: list[DanceTake], sizes, *, tell: bool = False) -> list[DanceTake]:
    """Those that a model can learn from which knows genres; all, where it knows none."""
    genres = getattr(sizes, "genres", None)
    if genres is None:
        return takes
    kept = [take for take in takes if take.genre in genres]
    if tell and kept:  # without any, training ends with an error
        tell_other_genres(takes, genres, "left out")
    return kept


def has_codebook(model: AutoregressiveNetwork) -> bool:
    """Does it learn a vocabulary of units?"""
    return any(isinstance(part, VectorQuantizer) for part in model.modules())


def _trained(
    model: AutoregressiveNetwork,
    stage: str,
    settings: TrainConfig | None,
    folder: Path,
    windows: WindowSampler,
    validation: WindowSampler | None,
    preview: Callable | None,
    options: dict[str, Any],
) -> AutoregressiveNetwork:
    """The averaged network of a stage, whose other parts stay as they are."""
    if settings is None:
        return kept_of(model, folder)
    model.requires_grad_(False)
    for part in model.learning(stage):
        part.requires_grad_(True)
    later = options.pop("later")
    trainer = options.pop("trainer")(
        model,
        windows,
        settings,
        folder,
        objective=StageObjective(model, settings, stage),
        evaluator=Evaluator(validation, settings, preview),
        **options,
    )
    trainer.label = f"training {stage}"
    make_way(trainer, later, overwrite=options.get("overwrite", False))
    return trainer.run()
