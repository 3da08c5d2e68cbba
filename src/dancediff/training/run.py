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
from dancediff.extensions.build import build, check_extensions, paper_class
from dancediff.extensions.genre_condition import check_genres
from dancediff.extensions.own_class import own_network
from dancediff.genre import GENRES
from dancediff.nn.dance_network import DanceNetwork
from dancediff.nn.sizes import check_sizes
from dancediff.own import is_own
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.gcd.model import GCD, GCDConfig
from dancediff.papers.tcdiff.model import TCDiff, TCDiffConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.autoregressive import (
    MODELS as AUTOREGRESSIVE,
)
from dancediff.training.autoregressive import is_autoregressive, train_autoregressive
from dancediff.training.checkpoint import NAME, check_free
from dancediff.training.config import GroupData, TrainConfig, TrainingExtensions
from dancediff.training.cuda_graph import trainer_for
from dancediff.training.evaluator import Evaluator
from dancediff.training.gcd import GCDObjective
from dancediff.training.group_takes import solos_of, takes_for, windows_of
from dancediff.training.lodge import is_lodge, train_lodge
from dancediff.training.objective import GroupObjective
from dancediff.training.own_network import check_network
from dancediff.training.statistics import fit_statistics, take_over
from dancediff.training.tables import check_all, read_training
from dancediff.training.tcdiff import TCDiffObjective
from dancediff.training.trainer import Trainer, name_of
from dancediff.training.validation_metrics import ValidationMetrics

MODELS: dict[str, tuple[type[DanceNetwork], type]] = {
    "TCDiffPP": (TCDiffPP, TCDiffPPConfig),
    "EDGE": (EDGE, EDGEConfig),
    "GCD": (GCD, GCDConfig),
    "TCDiff": (TCDiff, TCDiffConfig),
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
        words = ", ".join([*MODELS, *AUTOREGRESSIVE])
        raise ValueError(
            f"class {kind!r} is not one of {words}, Lodge, nor 'module:Class' of your own"
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
      choreographed corpus and whose validation split is evaluated on; ``takes`` does so directly.
      With ``class = "Lodge"`` all of it is up to `dancediff.training.lodge.train_lodge`, and
      ``takes`` are solos; other classes have `dancediff.training.autoregressive`.
    - ``start``: a trained model to start from, see `take_over`; of those in `MODELS`.
    - ``preview(model, step)``: see `dancediff.training.evaluator`.
    - ``trainer``: a class that trains in another way, every stage. By default `Trainer`, or on a
      GPU see `trainer_for`.
    - ``options``: ``device``, or a ``world`` that brings its own; ``resume``, ``overwrite``,
      ``log``: see `dancediff.training.trainer.Trainer`.

    Raises: ValueError for a bad config or folder.
    """
    raw, source = read_training(path), repr(str(path))
    if is_lodge(raw):
        if start is not None:
            raise ValueError("start is not for Lodge, whose stages are trained one after the other")
        options |= {"solos": takes, "data": data, "preview": preview, "trainer": trainer}
        return train_lodge(raw, out, source=source, **options)
    if is_autoregressive(raw):
        if start is not None:
            raise ValueError(f"start is for {', '.join(MODELS)} only; leave it out")
        options |= {"takes": takes, "data": data, "preview": preview}
        return train_autoregressive(raw, out, source=source, trainer=trainer or Trainer, **options)
    if start is not None and not isinstance(start, DanceNetwork):
        raise ValueError(f"start, a {type(start).__name__}, is none of {', '.join(MODELS)}")
    tables = check_tables(raw, source)
    settings, corpus = settings_of(tables), GroupData(**tables["data"])
    check_free(Path(out), options.get("resume"), options.get("overwrite"))
    model_class, config_class = network_classes(tables["model"].pop("class", "TCDiffPP"))
    extensions, genres = (tables["model"].pop(name, ()) for name in ("extensions", "genres"))
    sizes = config_class(**tables["model"])
    held_out: list[DanceTake] = []
    if takes is None:
        evaluates = settings.evaluate_every > 0 or settings.metrics_every > 0
        takes, held_out = takes_for(corpus, data, sizes, evaluates=evaluates)
    torch.manual_seed(settings.seed)
    model: DanceNetwork = build(model_class, sizes, extensions, genres)
    if all(model_class is not ours for ours, _ in MODELS.values()):
        check_network(model, paper_class(model_class))
    if isinstance(model, EDGE):
        takes, held_out = solos_of(takes), solos_of(held_out)
    if not (options.get("resume") and (Path(out) / NAME).exists()):  # else it holds all of this
        _begin(model, takes, settings, corpus, start)
    how: dict[str, Any] = {"seed": settings.seed, "any_song": settings.extensions.any_song}
    windows = partial(windows_of, corpus=corpus, model=model, **how)
    validation = windows(takes=held_out) if held_out else None
    metrics = ValidationMetrics(validation, Path(out) / "metrics.csv") if validation else None
    device, world = options.pop("device", "cpu"), options.get("world")
    model = model.to(device if world is None else world.device)
    objective = objective_class(model_class)(model, settings)
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
