r"""From a TOML file to a trained model: what ``dancediff train`` runs.

Read first: `dancediff.training.config` and `dancediff.training.trainer`.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import nn

from dancediff.data.take import DanceTake
from dancediff.extensions.build import FAMILIES, NETWORKS, build, check_extensions, paper_class
from dancediff.extensions.genre_condition import check_genres, genres_of
from dancediff.extensions.own_network import own_network
from dancediff.extensions.registry import check_training
from dancediff.genre import GENRES
from dancediff.nn.dance_network import DanceNetwork
from dancediff.nn.sizes import check_sizes
from dancediff.own import is_own
from dancediff.papers.edge.model import EDGE
from dancediff.papers.gcd.model import GCD
from dancediff.papers.tcdiff.model import TCDiff
from dancediff.training.autoregressive import (
    MODELS as AUTOREGRESSIVE,
)
from dancediff.training.autoregressive import is_autoregressive, train_autoregressive
from dancediff.training.checkpoint import NAME
from dancediff.training.config import GroupData, TrainConfig, TrainingExtensions
from dancediff.training.cuda_graph import trainer_for
from dancediff.training.evaluator import Evaluator
from dancediff.training.folder import check_out, clear_out
from dancediff.training.gcd import GCDObjective
from dancediff.training.group_takes import (
    held_out_takes,
    solos_of,
    takes_for,
    tell_other_genres,
    windows_of,
)
from dancediff.training.lodge import is_lodge, train_lodge
from dancediff.training.network_check import check_network
from dancediff.training.objective import GroupObjective
from dancediff.training.statistics import fit_statistics, take_over
from dancediff.training.tables import check_all, read_training
from dancediff.training.tcdiff import TCDiffObjective
from dancediff.training.trainer import Trainer, name_of
from dancediff.training.validation_metrics import METRICS_FILE, ValidationMetrics

MODELS: dict[str, tuple[type[DanceNetwork], type]] = {
    name: NETWORKS[name] for name in ("TCDiffPP", "EDGE", "GCD", "TCDiff")
}
OBJECTIVES: dict[type, type[GroupObjective]] = {  # else `GroupObjective`
    GCD: GCDObjective,
    TCDiff: TCDiffObjective,
}
NAMES = ("extensions", "genres")  # lists of names in the table [model] beside the sizes


def read_config(path) -> dict:
    """Read and check a training config.

    Raises: ValueError naming the file, the table and the key that does not fit.
    """
    return check_tables(read_training(path), repr(str(path)))


def check_tables(config: dict, source: str) -> dict:
    """All tables of a training config.

    ``class`` in its table ``model`` is a key of `MODELS`, or "module:Class" of the user's own.

    With the extension "genre_condition" that table also lists ``genres``, by default all.

    Raises: ValueError naming the source, the table and the key that does not fit.
    """
    model = config.get("model", {})
    kind = model.get("class", "TCDiffPP") if isinstance(model, dict) else "TCDiffPP"
    try:
        model_class, config_class = network_classes(kind)
    except ValueError as err:
        raise ValueError(f"{source}: {err}") from err
    names, genres = [], None
    if isinstance(model, dict):
        check_sizes(model, f"{source}: 'model'")
        names, genres = model.get("extensions", []), model.get("genres")
        sizes = {key: value for key, value in model.items() if key not in NAMES}
        config = config | {"model": sizes}
    tables = check_all(config, tables_of(model_class, config_class), source)
    for key, value in zip(NAMES, (names, [] if genres is None else genres), strict=True):
        if not isinstance(value, list | tuple):
            raise ValueError(f"{source}: 'model': {key}={value!r} should be a list of names")
    sizes = {key: value for key, value in tables["model"].items() if key != "class"}
    try:
        check_extensions(model_class, config_class(**sizes), names)
        if genres is not None:
            check_genres(genres)
    except ValueError as err:
        raise ValueError(f"{source}: 'model': {err}") from err
    family = FAMILIES[paper_class(model_class)]
    check_training(tables["extensions"], family, names, f"{source}: 'extensions'")
    tables["model"]["extensions"] = list(names)
    if "genre_condition" in names:
        tables["model"]["genres"] = list(GENRES if genres is None else genres)
    elif genres is not None:
        raise ValueError(f"{source}: 'model': genres need the extension 'genre_condition'; name it")
    return tables


def network_classes(kind) -> tuple[type, type]:
    """The network that a config names, and the class of its sizes.

    A class of the user's own may have an attribute ``config_class``, derived from the paper's.

    Raises: ValueError when there is none of that name.
    """
    if is_own(kind):
        model_class = own_network(kind)
        usual = MODELS[paper_class(model_class).__name__][1]
        return model_class, getattr(model_class, "config_class", usual)
    if not isinstance(kind, str) or kind not in MODELS:
        raise ValueError(
            f"class {kind!r} is not one of {', '.join(MODELS)}, Lodge, nor 'module:Class' of your "
            f"own; {', '.join(AUTOREGRESSIVE)} can be trained, but not ablated"
        )
    return MODELS[kind]


def objective_class(model_class: type[nn.Module]) -> type[GroupObjective]:
    """What a network of a group is trained to do.

    >>> objective_class(EDGE).__name__, objective_class(GCD).__name__
    ('GroupObjective', 'GCDObjective')
    """
    return OBJECTIVES.get(paper_class(model_class), GroupObjective)


def tables_of(model_class: type[nn.Module], config_class: type) -> dict[str, type]:
    """The tables of a config for a network and the class of its sizes."""
    return {
        "data": GroupData,
        "model": config_class,
        "train": TrainConfig,
        "weights": objective_class(model_class).weights,
        "extensions": TrainingExtensions,
    }


def own_class_in(path) -> str | None:
    """The class of the user's own that a config names, or None.

    Raises: ValueError naming the file when it is missing or no TOML.
    """
    model = read_training(path)["model"]
    kind = model.get("class") if isinstance(model, dict) else None
    return kind if is_own(kind) else None


def settings_of(tables: dict) -> TrainConfig:
    """How to train, of checked tables."""
    extensions = TrainingExtensions(**tables["extensions"])
    model_class, _ = network_classes(tables["model"].get("class", "TCDiffPP"))
    weights = objective_class(model_class).weights(**tables["weights"])
    return TrainConfig(**tables["train"], weights=weights, extensions=extensions)


def train_from_config(
    path,
    out,
    *,
    takes: list[DanceTake] | None = None,
    data=None,
    start: nn.Module | None = None,
    preview: Callable | None = None,
    trainer: type[Trainer] | None = None,
    **options,
):
    """Make or read the data, build the model, train it; returns the averaged model.

    - ``data``, else ``folder`` in the config: a prepared folder, whose training split replaces the
      choreographed corpus and whose validation split is evaluated on.
    - ``takes`` replaces what is learned from, not what is evaluated on; for Lodge they are solos.
    - ``start``: a trained model to start from, see `take_over`; of those in `MODELS`.
    - ``preview(model, step)``: see `dancediff.training.evaluator`.
    - ``trainer``: a class that trains in another way, every stage. By default `Trainer`, or on a
      GPU see `trainer_for`.
    - ``options``: ``device``, or a ``world`` that brings its own; ``resume``, ``overwrite``,
      ``log``: see `dancediff.training.trainer.Trainer`.

    Raises: ValueError for a bad config or folder.
    """
    raw, source = read_training(path), repr(str(path))
    if start is not None and (is_lodge(raw) or is_autoregressive(raw)):
        raise ValueError(f"start is for {', '.join(MODELS)} only; leave it out")
    if start is not None and not isinstance(start, DanceNetwork):
        raise ValueError(f"start, a {type(start).__name__}, is none of {', '.join(MODELS)}")
    options |= {"data": data, "preview": preview}
    if is_lodge(raw):
        return train_lodge(raw, out, source=source, solos=takes, trainer=trainer, **options)
    options |= {"takes": takes}
    if is_autoregressive(raw):
        return train_autoregressive(raw, out, source=source, trainer=trainer or Trainer, **options)
    return _train_denoiser(check_tables(raw, source), out, start=start, trainer=trainer, **options)


def _train_denoiser(
    tables: dict,
    out,
    *,
    takes: list[DanceTake] | None,
    data,
    start: DanceNetwork | None,
    preview: Callable | None,
    trainer: type[Trainer] | None,
    **options,
) -> DanceNetwork:
    """As `train_from_config`, of checked tables with a class of `MODELS` or of the user's own."""
    settings, corpus = settings_of(tables), GroupData(**tables["data"])
    kind, _ = network_classes(tables["model"].get("class", "TCDiffPP"))
    said = {name: options.get(name) for name in ("resume", "overwrite")}
    check_out(Path(out), kind, [Path(out)], **said)
    model = _new_network(tables["model"], settings.seed)
    if takes is None:
        takes = takes_for(corpus, data, model.config)
    if genres := genres_of(model):
        told = [take for take in takes if take.genre is not None]
        tell_other_genres(told, genres, "learned without a genre")
    evaluates = settings.evaluate_every > 0 or settings.metrics_every > 0
    held_out = held_out_takes(corpus, data, model.config) if evaluates else []
    if isinstance(model, EDGE):
        takes, held_out = solos_of(takes), solos_of(held_out)
    if not (options.get("resume") and (Path(out) / NAME).exists()):  # else it holds all of this
        _begin(model, takes, settings, corpus, start)
    how: dict[str, Any] = {"seed": settings.seed, "any_song": settings.extensions.any_song}
    windows = partial(windows_of, corpus=corpus, model=model, **how)
    validation = windows(takes=held_out) if held_out else None
    metrics = ValidationMetrics(validation, Path(out) / METRICS_FILE) if validation else None
    device, world = options.pop("device", "cpu"), options.get("world")
    model = model.to(device if world is None else world.device)
    objective = objective_class(type(model))(model, settings)
    if options.get("overwrite") and (world is None or world.first):
        clear_out(Path(out), kind)
    return (trainer or trainer_for(objective, settings, world))(
        model,
        windows(takes=takes),
        settings,
        out,
        objective=objective,
        evaluator=Evaluator(validation, settings, preview, metrics),
        data_name=name_of(takes, tables["data"]),
        **options,
    ).run()


def _new_network(table: dict, seed: int) -> DanceNetwork:
    """The network of the checked table [model], with random weights; one's own is tried out.

    Raises: ValueError naming the part of the user's own that does not fit.
    """
    model_class, config_class = network_classes(table.get("class", "TCDiffPP"))
    extensions, genres = (table.get(name, ()) for name in NAMES)
    sizes = {key: value for key, value in table.items() if key not in ("class", *NAMES)}
    torch.manual_seed(seed)  # of torch's own generator: from it layers draw their weights
    model: DanceNetwork = build(model_class, config_class(**sizes), extensions, genres)
    if all(model_class is not ours for ours, _ in MODELS.values()):
        check_network(model, paper_class(model_class))
    return model


def _begin(
    model: DanceNetwork,
    takes: list[DanceTake],
    settings: TrainConfig,
    corpus: GroupData,
    start: DanceNetwork | None,
) -> None:
    """Fit a new network's statistics, and give it what a trained one has learned."""
    known: dict[str, Any] = {"real": corpus.real, "mirror": corpus.mirror > 0, "start": start}
    fit_statistics(model, takes, settings.extensions, **known)
    if start is not None:
        take_over(model, start)
