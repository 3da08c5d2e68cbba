r"""Train Lodge from a TOML file: the global stage, the local stage, and its fine-tuning.

Tables of the file
    [data]                    where the takes are, and how windows are drawn
    [model]                   class = "Lodge"
    [global_stage]            see GlobalConfig;  [local_stage]  see LocalConfig
    [train]                   see TrainConfig, for all stages
    [train_global], [train_local], [train_fine_tune]        what differs from it; with steps = 0 a
                              stage is not trained, and taken from its folder if it is there
    [weights_global], [weights_local], [weights_fine_tune]  see LodgeWeights
    [discriminator]           see DiscriminatorConfig; only with this table there is one
    [extensions]              see TrainingExtensions
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch

from dancediff.data.augment import Augmentation
from dancediff.data.take import DanceTake
from dancediff.data.windows import SoloCut, WindowSampler
from dancediff.extensions.metre_unit import metre_unit_normalizer
from dancediff.motion.representation import LODGE, Normalizer
from dancediff.music.features import MusicNormalizer
from dancediff.papers.lodge.genre_discriminator import DiscriminatorConfig
from dancediff.papers.lodge.global_diffusion import GlobalConfig, GlobalDenoiser
from dancediff.papers.lodge.local_diffusion import LocalConfig, LocalDenoiser
from dancediff.papers.lodge.losses import LodgeWeights
from dancediff.papers.lodge.model import Lodge, LodgeConfig
from dancediff.papers.lodge.parallel import layout_of
from dancediff.papers.lodge.primitives import Layout
from dancediff.training.checkpoint import NAME, check_free, load_average
from dancediff.training.config import SoloData, TrainConfig, TrainingExtensions
from dancediff.training.evaluator import Evaluator
from dancediff.training.lodge_data import (
    PrimitiveCut,
    choreographed_solos,
    half_windows,
    long_enough,
    prepared_solos,
)
from dancediff.training.lodge_losses import Critic, LodgeObjective
from dancediff.training.statistics import PLAIN, window_weights
from dancediff.training.tables import check_all, check_sizes
from dancediff.training.trainer import Trainer, name_of

STAGES = {
    "global": LodgeWeights.coarse,
    "local": LodgeWeights.local,
    "fine_tune": LodgeWeights.fine_tune,
}


@dataclass(frozen=True)
class _Model:
    """The table [model] has its class alone."""


@dataclass(frozen=True)
class _Stage(TrainConfig):
    """A table of settings, in which ``steps = 0`` leaves a stage out."""

    def __post_init__(self):
        if self.steps != 0:
            super().__post_init__()


def check_lodge_tables(config: dict, source: str) -> dict:
    """All tables of a training config of Lodge, empty where left out.

    Raises: ValueError naming the source, the table and the key that does not fit.
    """
    known = {
        "data": SoloData,
        "model": _Model,
        "global_stage": GlobalConfig,
        "local_stage": LocalConfig,
        "train": _Stage,
        "extensions": TrainingExtensions,
    }
    for stage in STAGES:
        known |= {f"train_{stage}": _Stage, f"weights_{stage}": LodgeWeights}
    if "discriminator" in config:  # without its table there is none
        known["discriminator"] = DiscriminatorConfig
    for table in ("global_stage", "local_stage", "discriminator"):
        if isinstance(config.get(table), dict):
            check_sizes(config[table], f"{source}: {table!r}")
    return check_all(config, known, source)


def is_lodge(tables: dict) -> bool:
    """Are these the tables of a training of Lodge?"""
    model = tables.get("model")
    return isinstance(model, dict) and model.get("class") == "Lodge"


def stage_config(tables: dict, stage: str) -> TrainConfig | None:
    """How a stage is trained; None for ``steps = 0``.

    >>> tables = {"train": {"steps": 5}, "train_local": {"steps": 7}, "extensions": {}}
    >>> stage_config(tables | {"weights_local": {"jacc": 0.5}}, "local").steps
    7
    """
    settings = tables["train"] | tables[f"train_{stage}"]
    if settings.get("steps") == 0:
        return None
    extensions = TrainingExtensions(**tables["extensions"])
    slide = 0.0 if stage == "global" else extensions.slide_loss  # primitives are eight frames
    weights = STAGES[stage](**tables[f"weights_{stage}"], slide=slide)
    return TrainConfig(**settings, weights=weights, extensions=extensions)


def fit_stage(
    model: GlobalDenoiser | LocalDenoiser,
    windows: WindowSampler,
    extensions: TrainingExtensions = PLAIN,
) -> None:
    """Set the scales of motion and music and the spectrum of dance from the windows, once."""
    extremes = torch.cat(
        [torch.stack([x.amin((0, 1)), x.amax((0, 1))]) for x in half_windows(windows)]
    )  # all pieces at once would take gigabytes
    model.normalizer = (
        metre_unit_normalizer(extremes, LODGE, at_most=True)  # primitives do not get that far
        if extensions.metre_unit
        else Normalizer.fit(extremes)
    )
    songs = {solo.M.data_ptr(): solo.M for solo in windows.takes}
    music = MusicNormalizer.fit(list(songs.values()))
    model.music_normalizer = music.without(extensions.masked_music)
    frames = [(solo.real, solo.num_frames) for solo in windows.takes]
    model.fit_precondition(
        (model.normalizer.normalize(x) for x in half_windows(windows)),
        weights=window_weights(frames, windows.real),
    )


def train_lodge(
    config: dict,
    out,
    *,
    source: str = "config",
    solos: list[DanceTake] | None = None,
    data=None,
    preview: Callable | None = None,
    device: str = "cpu",
    **options,
) -> Lodge:
    """Train all stages, one after the other, in folders of ``out``; returns the averaged models.

    ``data``, else ``folder`` in the config: a prepared folder; else the choreographer's solos;
    ``solos`` replaces both.  ``preview(model, step)`` sees a `Lodge`, from the local stage on.
    ``options``: ``world``, which brings its own device; ``resume``, ``overwrite``: see
    `dancediff.training.trainer.Trainer`.

    Raises: ValueError for a bad config or folder, or takes that are too short for a global segment.
    """
    tables = check_lodge_tables(config, source)
    coarse = GlobalConfig(**tables["global_stage"])
    sizes = LodgeConfig(coarse, LocalConfig(**tables["local_stage"]))
    settings = {stage: stage_config(tables, stage) for stage in STAGES}
    extensions, corpus = TrainingExtensions(**tables["extensions"]), SoloData(**tables["data"])
    out = Path(out)
    for stage in (name for name in STAGES if settings[name] is not None):
        check_free(out / stage, options.get("resume"), options.get("overwrite"))
    if solos is None:
        solos = solos_for(corpus, data, sizes.genres)
    seed = tables["train"].get("seed", 0)
    cut = partial(_windows, corpus=corpus, extensions=extensions, sizes=sizes, seed=seed)
    evaluates = any(one is not None and one.evaluate_every for one in settings.values())
    held_out = _held_out(corpus, data, sizes.genres) if evaluates else []
    device = device if options.get("world") is None else options["world"].device

    model = _start(GlobalDenoiser, coarse, tables).to(device)
    layout = layout_of(model)
    windows = cut(solos, layout=layout)
    fit_stage(model, windows, extensions)
    objective = LodgeObjective(model, settings["global"])
    validation = cut(held_out, layout=layout) if held_out else None
    first = _train(objective, windows, out / "global", validation, **options)

    model = _start(LocalDenoiser, sizes.local_stage, tables).to(device)
    windows = cut(solos)
    fit_stage(model, windows, extensions)
    validation = cut(held_out) if held_out else None
    show = preview and (lambda made, step: preview(Lodge.of(first, made).eval(), step))
    for stage in ("local", "fine_tune"):
        kept = out / stage if options.get("resume") else None
        critic = _critic(tables, sizes, settings[stage], device, kept)
        objective = LodgeObjective(
            model, settings[stage], clean=stage == "fine_tune", critic=critic
        )
        model = _train(objective, windows, out / stage, validation, preview=show, **options)
    return Lodge.of(first, model).eval()


def _start(kind, sizes, tables: dict):
    torch.manual_seed(tables["train"].get("seed", 0))
    return kind(sizes)


def solos_for(
    corpus: SoloData, folder, genres: tuple[str, ...], cache: Path | None = None
) -> list[DanceTake]:
    """Solos to learn from: those of a prepared folder, else the choreographer's."""
    if folder := folder or corpus.folder:
        return prepared_solos(folder, genres)
    after = corpus.first_seed + corpus.songs
    options = {"workers": corpus.workers, "cache": cache}
    return choreographed_solos(range(corpus.first_seed, after), corpus.seconds, genres, **options)


def _held_out(corpus: SoloData, folder, genres: tuple[str, ...]) -> list[DanceTake]:
    """Solos to evaluate on; none, with a warning, where a prepared folder has none."""
    if folder := folder or corpus.folder:
        try:
            return prepared_solos(folder, genres, "val")
        except ValueError as err:
            warnings.warn(f"there is no validation: {err}", stacklevel=3)
            return []
    after = corpus.first_seed + corpus.songs
    return choreographed_solos(range(after, after + corpus.held_out), corpus.seconds, genres)


def _windows(
    solos: list[DanceTake],
    corpus: SoloData,
    extensions: TrainingExtensions,
    sizes: LodgeConfig,
    seed: int,
    layout: Layout | None = None,
) -> WindowSampler:
    """Windows for the local stage, or primitives for the global one, whose ``layout`` they have."""
    batch = corpus.windows_per_batch if layout is None else corpus.global_windows_per_batch
    if layout is None:
        cut = SoloCut(sizes.num_frames, sizes.genres)
    else:
        cut = PrimitiveCut(layout, sizes.genres)
    augment = Augmentation(mirror=corpus.mirror, music=corpus.music, any_song=extensions.any_song)
    return WindowSampler(
        long_enough(solos, cut),
        cut,
        augment=augment,
        dancers_per_batch=batch,
        real=corpus.real,
        seed=seed,
    )


def _critic(tables, sizes: LodgeConfig, settings, device, kept: Path | None) -> Critic | None:
    """The discriminator, as it was left in the folder ``kept``, if the config has one."""
    if "discriminator" not in tables or settings is None:
        return None
    fixed = {"num_frames": sizes.num_frames, "genres": sizes.genres}
    return Critic(
        DiscriminatorConfig(**fixed | tables["discriminator"]),
        lr=settings.lr,
        weight=settings.weights.critic,
        checkpoint=kept and kept / NAME,
        device=device,
    )


def _train(
    objective: LodgeObjective, windows, folder: Path, validation=None, *, preview=None, **options
):
    """Train one stage; returns the averaged model, ready to be trained on."""
    model, settings = objective.model, objective.config
    if settings is None:
        kept = folder / NAME
        return load_average(kept, model) if kept.exists() else model
    name = name_of(windows.takes, {})
    trainer = Trainer(
        model,
        windows,
        settings,
        folder,
        objective=objective,
        evaluator=Evaluator(validation, settings, preview),
        data_name=name,
        **options,
    )
    return trainer.run().requires_grad_(True)
