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
"""

from collections.abc import Callable, Iterable
from pathlib import Path

import torch

from dancediff.data.choreographed import choreograph_jobs
from dancediff.extensions.metre_unit import FLOOR_UNIT, MIN_SPAN
from dancediff.motion.representation import LODGE, Normalizer
from dancediff.music.features import MusicNormalizer
from dancediff.papers.lodge.genre_discriminator import DiscriminatorConfig
from dancediff.papers.lodge.global_diffusion import GlobalConfig, GlobalDenoiser
from dancediff.papers.lodge.local_diffusion import LocalConfig, LocalDenoiser
from dancediff.papers.lodge.losses import LodgeWeights
from dancediff.papers.lodge.model import Lodge, LodgeConfig
from dancediff.papers.lodge.parallel import layout_of
from dancediff.training.checkpoint import NAME, check_free, load_average
from dancediff.training.config import TrainConfig
from dancediff.training.distributed import World
from dancediff.training.evaluator import Evaluator
from dancediff.training.lodge_data import Solo, SoloWindows, prepared_solos, solos_of
from dancediff.training.lodge_losses import Critic, LodgeObjective
from dancediff.training.tables import check_all, kinds_of
from dancediff.training.trainer import Trainer, name_of

STAGES = {
    "global": LodgeWeights.coarse,
    "local": LodgeWeights.local,
    "fine_tune": LodgeWeights.fine_tune,
}
_CORPUS = {"folder": str, "songs": int, "first_seed": int, "seconds": float, "unheard": list}
_WINDOWS = {
    "windows_per_batch": int,
    "mirror": float,
    "captured": float,
    "music": bool,
    "any_song": float,
}


def check_lodge_tables(config: dict, source: str) -> dict:
    """All tables of a training config of Lodge, empty where left out.

    Raises: ValueError naming the source, the table and the key that does not fit.
    """
    train = kinds_of(TrainConfig)
    del train["weights"]
    known = {
        "data": _CORPUS | _WINDOWS | {"global_windows_per_batch": int},
        "model": {"class": str},
        "global_stage": kinds_of(GlobalConfig),
        "local_stage": kinds_of(LocalConfig),
        "train": train,
    }
    for stage in STAGES:
        known |= {f"train_{stage}": train, f"weights_{stage}": kinds_of(LodgeWeights)}
    if "discriminator" in config:  # without its table there is none
        known["discriminator"] = kinds_of(DiscriminatorConfig)
    return check_all(config, known, source)


def is_lodge(tables: dict) -> bool:
    """Are these the tables of a training of Lodge?"""
    model = tables.get("model")
    return isinstance(model, dict) and model.get("class") == "Lodge"


def stage_config(tables: dict, stage: str) -> TrainConfig | None:
    """How a stage is trained; None for ``steps = 0``.

    >>> tables = {"train": {"steps": 5, "lr": 1e-4}, "train_local": {"steps": 7}}
    >>> stage_config(tables | {"weights_local": {"jacc": 0.5}}, "local").steps
    7
    """
    settings = tables["train"] | tables[f"train_{stage}"]
    if settings.get("steps") == 0:
        return None
    return TrainConfig(**settings, weights=STAGES[stage](**tables[f"weights_{stage}"]))


def fit_stage(
    model: GlobalDenoiser | LocalDenoiser, windows: SoloWindows, unheard: Iterable[str] = ()
) -> None:
    """Set the scales of motion and music and the spectrum of dance from the windows, once.

    ``unheard``: blocks of the music that the model shall be deaf to, see `MusicNormalizer.without`.
    """
    low_high = [
        torch.stack([x.amin((0, 1)), x.amax((0, 1))]) for x in windows.pieces()
    ]  # all pieces at once would take gigabytes
    model.normalizer = norm = Normalizer.fit(torch.cat(low_high), min_span=MIN_SPAN)
    on_floor = LODGE.floor  # a primitive never gets as far as a unit
    norm.low[on_floor] = norm.low[on_floor].clamp_min(-FLOOR_UNIT)
    norm.high[on_floor] = norm.high[on_floor].clamp_max(FLOOR_UNIT)
    songs = {solo.songs.data_ptr(): solo.songs[0] for solo in windows.solos}
    model.music_normalizer = MusicNormalizer.fit(list(songs.values())).without(unheard)
    model.fit_precondition(
        (model.normalizer.normalize(x) for x in windows.pieces()), weights=_weights(windows)
    )


def _weights(windows: SoloWindows) -> list[float]:
    """How much a window of each solo counts, so that captured ones have their share together."""
    frames = {False: 0, True: 0}
    for solo in windows.solos:
        frames[solo.captured] += len(solo.x)
    share = windows.captured
    if share is None or not all(frames.values()):
        return [1.0] * len(windows.solos)
    part = {False: (1 - share) / frames[False], True: share / frames[True]}
    return [part[solo.captured] for solo in windows.solos]


def train_lodge(
    config: dict,
    out,
    *,
    source: str = "config",
    solos: list[Solo] | None = None,
    data=None,
    resume: bool = False,
    overwrite: bool = False,
    device: str = "cpu",
    world: World | None = None,
    preview: Callable | None = None,
) -> Lodge:
    """Train all stages, one after the other, in folders of ``out``; returns the averaged models.

    ``data``, else ``folder`` in the config: a prepared folder; else the choreographer's solos;
    ``solos`` replaces both.  ``preview(model, step)`` sees a `Lodge`, from the local stage on.

    Raises: ValueError for a bad config or folder, or takes that are too short for a global segment.
    """
    tables = check_lodge_tables(config, source)
    coarse = GlobalConfig(**tables["global_stage"])
    sizes = LodgeConfig(coarse, LocalConfig(**tables["local_stage"]))
    settings = {stage: stage_config(tables, stage) for stage in STAGES}
    if solos is None:
        solos = _solos(tables["data"], data, sizes.genres)
    out = Path(out)
    for stage in (name for name in STAGES if settings[name] is not None):
        check_free(out / stage, resume=resume, overwrite=overwrite)
    unheard = tables["data"].get("unheard", ())
    device = device if world is None else world.device
    options = {"resume": resume, "overwrite": overwrite, "world": world}

    model = _start(GlobalDenoiser, coarse, tables).to(device)
    windows = _windows(tables, solos, sizes, layout_of(model), batch="global_windows_per_batch")
    fit_stage(model, windows, unheard)
    objective = LodgeObjective(model, settings["global"])
    first = _train(objective, windows, out / "global", **options)

    model = _start(LocalDenoiser, sizes.local_stage, tables).to(device)
    windows = _windows(tables, solos, sizes)
    fit_stage(model, windows, unheard)
    show = preview and (lambda made, step: preview(Lodge.of(first, made).eval(), step))
    for stage in ("local", "fine_tune"):
        critic = _critic(tables, sizes, settings[stage], device, out / stage if resume else None)
        objective = LodgeObjective(
            model, settings[stage], clean=stage == "fine_tune", critic=critic
        )
        model = _train(objective, windows, out / stage, preview=show, **options)
    return Lodge.of(first, model).eval()


def _start(kind, sizes, tables: dict):
    torch.manual_seed(tables["train"].get("seed", 0))
    return kind(sizes)


def _solos(corpus: dict, data, genres: tuple[str, ...]) -> list[Solo]:
    if data := data or corpus.get("folder"):
        return prepared_solos(data, genres)
    jobs = choreograph_jobs(
        corpus.get("songs", 100),
        seed=corpus.get("first_seed", 0),
        seconds=corpus.get("seconds", 40.0),
        sizes=(1,),
        share=0.0,
    )
    return solos_of((job.make() for job in jobs), genres)


def _windows(
    tables: dict, solos, sizes: LodgeConfig, layout=None, *, batch: str = "windows_per_batch"
) -> SoloWindows:
    options = {key: value for key, value in tables["data"].items() if key in _WINDOWS}
    if batch in tables["data"]:
        options["windows_per_batch"] = tables["data"][batch]
    return SoloWindows(
        solos,
        sizes.genres,
        num_frames=sizes.num_frames if layout is None else layout.global_frames,
        layout=layout,
        seed=tables["train"].get("seed", 0),
        **options,
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


def _train(objective: LodgeObjective, windows, folder: Path, *, preview=None, **options):
    """Train one stage; returns the averaged model, ready to be trained on."""
    model, settings = objective.model, objective.config
    if settings is None:
        kept = folder / NAME
        return load_average(kept, model) if kept.exists() else model
    show = Evaluator(None, settings, preview)
    name = name_of(windows.solos, {})
    trainer = Trainer(
        model,
        windows,
        settings,
        folder,
        objective=objective,
        evaluator=show,
        data_name=name,
        **options,
    )
    return trainer.run().requires_grad_(True)
