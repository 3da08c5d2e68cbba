r"""Train Lodge from a TOML file: the global stage, the local stage, and its fine-tuning.

Read first: `dancediff.training.run`, which does the same for the other models · Lodge sections 3.3
and 3.4.

Tables of the file
    [data]                    where the takes are, and how windows are drawn
    [model]                   class = "Lodge", extensions = [...], see extensions.lodge_stages
    [global_stage]            see GlobalConfig;  [local_stage]  see LocalConfig
    [train]                   see TrainConfig, for all stages
    [train_global], [train_local], [train_fine_tune]        what differs from it; with steps = 0 a
                              stage is not trained, and taken from its folder if it is there
    [weights_global], [weights_local], [weights_fine_tune]  see LodgeWeights
    [discriminator]           see DiscriminatorConfig; only with this table there is one
    [extensions]              see TrainingExtensions
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import torch

from dancediff.data.augment import Augmentation
from dancediff.data.take import DanceTake
from dancediff.data.windows import SoloCut, WindowSampler
from dancediff.extensions.build import build, check_extensions
from dancediff.extensions.energy_condition import has_energy_condition
from dancediff.extensions.metre_unit import metre_unit_normalizer
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.extensions.registry import check_training
from dancediff.motion.representation import LODGE, Normalizer
from dancediff.music.features import MusicNormalizer
from dancediff.nn.sizes import check_sizes
from dancediff.papers.lodge.genre_discriminator import DiscriminatorConfig
from dancediff.papers.lodge.global_diffusion import GlobalConfig, GlobalDenoiser
from dancediff.papers.lodge.local_diffusion import LocalConfig, LocalDenoiser
from dancediff.papers.lodge.losses import LodgeWeights
from dancediff.papers.lodge.model import Lodge, LodgeConfig
from dancediff.papers.lodge.primitives import Layout
from dancediff.training.boards import check_logs
from dancediff.training.checkpoint import NAME
from dancediff.training.config import SoloData, TrainConfig, TrainingExtensions
from dancediff.training.cuda_graph import trainer_for
from dancediff.training.distributed import World
from dancediff.training.evaluator import Evaluator
from dancediff.training.folder import check_out, clear_out
from dancediff.training.lodge_data import (
    PrimitiveCut,
    choreographed_solos,
    half_windows,
    long_enough,
    prepared_solos,
)
from dancediff.training.lodge_losses import DiscriminatorTraining, LodgeObjective
from dancediff.training.stages import (
    StageConfig,
    check_stages,
    kept_of,
    later_folders,
    make_way,
    stage_settings,
)
from dancediff.training.statistics import PLAIN, window_weights
from dancediff.training.tables import check_all
from dancediff.training.trainer import Trainer, name_of

Stage = TypeVar("Stage", GlobalDenoiser, LocalDenoiser)
STAGES = {
    "global": LodgeWeights.coarse,
    "local": LodgeWeights.local,
    "fine_tune": LodgeWeights.fine_tune,
}


@dataclass(frozen=True)
class _Model:
    """The table [model] names the extensions of the networks."""

    extensions: list = field(default_factory=list)

    def __post_init__(self):
        check_extensions(Lodge, None, self.extensions)


TABLES: dict[str, type] = {
    "data": SoloData,
    "model": _Model,
    "global_stage": GlobalConfig,
    "local_stage": LocalConfig,
    "train": StageConfig,
    **{f"train_{stage}": StageConfig for stage in STAGES},
    **{f"weights_{stage}": LodgeWeights for stage in STAGES},
    "discriminator": DiscriminatorConfig,
    "extensions": TrainingExtensions,
}


def check_lodge_tables(config: dict, source: str) -> dict:
    """All tables of a training config of Lodge, empty where left out.

    Raises: ValueError naming the source, the table and the key that does not fit.
    """
    known = dict(TABLES)
    if "discriminator" not in config:  # without its table there is none
        del known["discriminator"]
    for table in ("global_stage", "local_stage", "discriminator"):
        if isinstance(config.get(table), dict):
            check_sizes(config[table], f"{source}: {table!r}")
    tables = check_all(config, known, source)
    for key in ("num_frames", "genres"):
        if key in tables.get("discriminator", {}):
            raise ValueError(f"{source}: 'discriminator': {key} is that of 'local_stage'")
    check_stages(tables, STAGES, source)
    names = tables["model"].get("extensions", ())
    check_training(tables["extensions"], "lodge", names, f"{source}: 'extensions'")
    return tables


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
    extensions = TrainingExtensions(**tables["extensions"])
    if stage == "global":
        extensions = replace(extensions, slide_loss=0.0)  # primitives are eight frames
    weights = stage_weights(tables, stage)
    return stage_settings(tables, stage, weights=weights, extensions=extensions)


def stage_weights(tables: dict, stage: str) -> LodgeWeights:
    """The weights of a stage's losses."""
    return STAGES[stage](**tables[f"weights_{stage}"])


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
    songs = {M.data_ptr(): M for M in (solo.songs[0] for solo in windows.takes)}
    music = MusicNormalizer.fit(list(songs.values()))
    model.music_normalizer = music.without(extensions.masked_music)
    frames = [(solo.real, solo.num_frames) for solo in windows.takes]
    preconditioning = preconditioning_of(model)
    if preconditioning is not None:
        clips = model.clips if isinstance(model, GlobalDenoiser) else lambda x: x[:, None]
        pieces = (clips(model.normalizer.normalize(x)).flatten(0, 1) for x in half_windows(windows))
        preconditioning.fit(pieces, weights=window_weights(frames, windows.real))


def train_lodge(
    config: dict,
    out,
    *,
    source: str = "config",
    solos: list[DanceTake] | None = None,
    data=None,
    preview: Callable | None = None,
    **run,
) -> Lodge:
    """Train all stages, one after the other, in folders of ``out``; returns the averaged models.

    ``data``, else ``folder`` in the config: a prepared folder; else the choreographer's solos.
    ``solos`` replaces what is learned from, not what is evaluated on.
    ``preview(model, step)`` sees a `Lodge`, from the local stage on.
    ``run``: see `LodgeTraining`.

    Raises: ValueError for a bad config or folder, or takes that are too short for a global segment.
    """
    training = LodgeTraining(check_lodge_tables(config, source), out, **run)
    training.learn_from(solos, data)
    training.train_global()
    for stage in ("local", "fine_tune"):
        training.train_local(stage, preview)
    return training.model.eval()


class LodgeTraining:
    """Two networks, what they learn from, and their three trainings.

    ``resume``, ``overwrite``, ``world``, ``log``: see `dancediff.training.trainer.Trainer`.
    ``trainer``: what trains every stage; by default see `trainer_for`.
    """

    def __init__(
        self,
        tables: dict,
        out,
        *,
        resume: bool = False,
        overwrite: bool = False,
        device: str = "cpu",
        world: World | None = None,
        log: str | Sequence[str] = (),
        trainer: type[Trainer] | None = None,
    ):
        """Random weights."""
        self.tables, self.out = tables, Path(out)
        self.settings = {stage: stage_config(tables, stage) for stage in STAGES}
        self.extensions = TrainingExtensions(**tables["extensions"])
        self.corpus = SoloData(**tables["data"])
        self.options: dict[str, Any] = {"resume": resume, "overwrite": overwrite}
        self.options |= {"world": world, "log": check_logs(log)}
        self.trainer = trainer
        trained = [self.out / stage for stage in STAGES if self.settings[stage] is not None]
        check_out(self.out, Lodge, trained, resume=resume, overwrite=overwrite)
        torch.manual_seed(tables["train"].get("seed", 0))  # from it layers draw their weights
        self.model = build(Lodge, sizes_of(tables), tables["model"].get("extensions", ()))
        self.device = device if world is None else world.device

    def learn_from(self, solos: list[DanceTake] | None, data) -> None:
        """Load the solos, unless they are given, and fit the statistics of both stages to them.

        Only then the model goes to its device: what is fitted to solos is on the CPU, as they are.
        """
        sizes, corpus = self.model.config, self.corpus
        solos = solos_for(corpus, data, sizes.genres) if solos is None else solos
        evaluates = any(one is not None and one.evaluate_every for one in self.settings.values())
        held_out = _held_out(corpus, data, sizes.genres) if evaluates else []
        self.windows, self.validation = {}, {}
        for stage, layout in (("global", sizes.global_stage.layout), ("local", None)):
            self.windows[stage] = self.sampler(solos, layout)
            self.validation[stage] = self._validation(held_out, stage, layout) if held_out else None
        fit_stage(self.model.global_stage, self.windows["global"], self.extensions)
        fit_stage(self.model.local_stage, self.windows["local"], self.extensions)
        self.model.to(self.device)
        world = self.options["world"]  # the first process writes, and so removes
        if self.options["overwrite"] and (world is None or world.first):
            clear_out(self.out, Lodge)

    def sampler(self, solos: list[DanceTake], layout: Layout | None) -> WindowSampler:
        """Windows for the local stage, or primitives for the global one, whose layout they have."""
        sizes, corpus = self.model.config, self.corpus
        batch = corpus.windows_per_batch if layout is None else corpus.global_windows_per_batch
        cut: SoloCut | PrimitiveCut = SoloCut(sizes.num_frames, sizes.genres)
        if layout is not None:
            cut = PrimitiveCut(layout, sizes.genres)
        any_song = self.extensions.any_song
        return WindowSampler(
            long_enough(solos, cut),
            cut,
            energy=has_energy_condition(self.model),
            augment=Augmentation(mirror=corpus.mirror, music=corpus.music, any_song=any_song),
            dancers_per_batch=batch,
            real=corpus.real,
            seed=self.tables["train"].get("seed", 0),
        )

    def _validation(
        self, held_out: list[DanceTake], stage: str, layout: Layout | None
    ) -> WindowSampler | None:
        """Windows to evaluate on; none, with a warning, where all solos are too short for them."""
        try:
            return self.sampler(held_out, layout)
        except ValueError as err:
            warnings.warn(f"the {stage} stage has no validation: {err}", stacklevel=4)
            return None

    def train_global(self) -> None:
        """The first stage learns primitives."""
        self.model.global_stage = self._trained(self.model.global_stage, "global")

    def train_local(self, stage: str, preview: Callable | None = None) -> None:
        """The second stage learns to dance ("local"), then to begin and end ("fine_tune")."""
        model = self.model
        show = None if preview is None else partial(self._show, preview)
        model.local_stage = self._trained(model.local_stage, stage, show)

    def _show(self, preview: Callable, made: LocalDenoiser, step: int) -> None:
        whole = Lodge(self.model.config, self.model.global_stage, made).eval()
        whole.extensions = self.model.extensions
        preview(whole, step)

    def _discriminator(self, stage: str, lr: float) -> DiscriminatorTraining | None:
        """The discriminator, if the config has one; as it was left, where the run goes on."""
        if "discriminator" not in self.tables or stage == "global":
            return None
        sizes, weights = self.model.config, stage_weights(self.tables, stage)
        fixed = {"num_frames": sizes.num_frames, "genres": sizes.genres}
        return DiscriminatorTraining(
            DiscriminatorConfig(**fixed | self.tables["discriminator"]),
            lr=lr,
            weight=weights.critic,
            form=weights.form,
            checkpoint=self.out / stage / NAME if self.options["resume"] else None,
            device=self.model.abar.device,
        )

    def _trained(self, network: Stage, stage: str, preview: Callable | None = None) -> Stage:
        """The averaged network of a stage, ready to be trained on."""
        settings, folder = self.settings[stage], self.out / stage
        if settings is None:
            return kept_of(network, folder)
        half = self.model.config.global_stage.primitive_frames // 2
        border = half if stage == "fine_tune" else 0
        kind = "global" if stage == "global" else "local"
        discriminator = self._discriminator(stage, settings.lr)
        objective = LodgeObjective(network, settings, border=border, discriminator=discriminator)
        kind_of_trainer = self.trainer or trainer_for(objective, settings, self.options["world"])
        trainer = kind_of_trainer(
            network,
            self.windows[kind],
            settings,
            folder,
            objective=objective,
            evaluator=Evaluator(self.validation[kind], settings, preview),
            data_name=name_of(self.windows[kind].takes, self.tables["data"]),
            **self.options,
        )
        trainer.label = f"training {stage}"
        make_way(trainer, self._later(stage), overwrite=self.options["overwrite"])
        return trainer.run().requires_grad_(True)

    def _later(self, stage: str) -> list[Path]:
        """Folders of the trained stages that begin with what ``stage`` learns, or anew with it."""
        if stage == "global" and not self.options["overwrite"]:
            return []  # the second network does not begin with the first one
        return later_folders(self.out, stage, self.settings)


def sizes_of(tables: dict) -> LodgeConfig:
    """The sizes of both stages."""
    return LodgeConfig(GlobalConfig(**tables["global_stage"]), LocalConfig(**tables["local_stage"]))


def solos_for(
    corpus: SoloData, folder, genres: tuple[str, ...], cache: Path | None = None
) -> list[DanceTake]:
    """Solos to learn from: those of a prepared folder, else the choreographer's."""
    if folder := folder or corpus.folder:
        return prepared_solos(folder, genres)
    options = {"varied": corpus.varied, "workers": corpus.workers, "cache": cache}
    return choreographed_solos(range(corpus.songs), corpus.seconds, genres, **options)


def _held_out(corpus: SoloData, folder, genres: tuple[str, ...]) -> list[DanceTake]:
    """Solos to evaluate on; none, with a warning, where none has one of the genres."""
    seeds = range(corpus.songs, corpus.songs + corpus.held_out)
    try:
        if folder := folder or corpus.folder:
            return prepared_solos(folder, genres, "val")
        return choreographed_solos(seeds, corpus.seconds, genres, varied=corpus.varied)
    except ValueError as err:
        warnings.warn(f"there is no validation: {err}", stacklevel=3)
        return []
