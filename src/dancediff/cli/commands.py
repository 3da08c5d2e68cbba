"""The commands, each with its options; torch is imported when one runs.

Read first: `dancediff.cli.files`, which names and saves what commands make.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from dancediff.cli.bench_models import BenchModels
from dancediff.cli.convert import Convert
from dancediff.cli.doctor import Doctor
from dancediff.cli.evaluate import Evaluate
from dancediff.cli.files import check_folder, tell
from dancediff.cli.gallery import Gallery
from dancediff.cli.generate import Generate
from dancediff.cli.live import Live
from dancediff.cli.study import Study


@dataclass
class Prepare:
    """Turn a data set into one folder of takes that training reads; a stopped run goes on."""

    source: tyro.conf.Positional[
        Literal["aioz", "finedance", "aistpp", "cmu", "choreograph", "songs", "folder"]
    ]
    """Which data set; folder: your own BVH, glTF, SMPL or .npz files. choreograph makes synthetic
    dances to synthetic songs, songs to your own."""
    src: tyro.conf.Positional[str]
    """The folder that holds the data set or the songs; for choreograph: how many dances."""
    dst: tyro.conf.Positional[Path]
    """Folder for the prepared data. What it already holds stays."""
    workers: int = 1
    """How many takes are prepared at once."""
    backend: Literal["loky", "dask", "ray"] = "loky"
    """Processes of this machine, or a Dask or Ray cluster."""
    scheduler: str | None = None
    """Address of a running cluster; default: one on this machine."""
    seconds: float | None = None
    """Length of a choreographed dance; default: 10, for songs 30."""
    seed: int | None = None
    """The first choreographed song; default: 0."""
    dances_per_song: int | None = None
    """For songs: how many parts of each are danced to; default: 5, one for each group size."""
    augment: int | None = None
    """For songs: how many changed versions of each are danced to as well; default: 0."""
    licence: str | None = None
    """For songs and folder: the licence of what no file beside it tells about."""
    split: Literal["genre", "dancer"] | None = None
    """For finedance: by genre, as both papers do and the default, or by dancer."""
    group: str | None = None
    """For folder: how files of one group are named, such as "{take}_{dancer}"."""
    fps: float | None = None
    """For folder: the true frame rate where the files' own is wrong."""
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    """For folder: the axis that points up; default: found from the bodies."""
    unit: float | None = None
    """For folder: metres to one unit of the files; default: found from the bodies."""
    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Prepare, then say what the folder holds and what was skipped."""
        from dancediff.data.sources import prepare_source
        from dancediff.viz.source_and_result import draw_source_and_result

        check_folder(self.dst, "DST")
        summary = prepare_source(
            self.source,
            self.src,
            self.dst,
            workers=self.workers,
            backend=self.backend,
            scheduler=self.scheduler,
            progress=not self.json,
            seconds=self.seconds,
            seed=self.seed,
            dances_per_song=self.dances_per_song,
            augment=self.augment,
            licence=self.licence,
            split=self.split,
            group=self.group,
            fps=self.fps,
            up=self.up,
            unit=self.unit,
            draw=draw_source_and_result,
        )
        lines = [str(summary), f"prepared data: {self.dst}"]
        if self.source == "folder":
            lines.append(f"check {self.dst / 'report.md'}, folder.toml and pictures/ beside it")
        tell(self.json, summary.facts(), lines)
        if not summary.prepared:
            reason = next(iter(summary.skipped.values()))
            raise RuntimeError(
                f"none of the {len(summary.skipped)} takes could be prepared: {reason}; "
                f"check {self.src!r}"
            )


@dataclass
class Train:
    """Train a model from a TOML config and write it as a model folder.

    --explain says what can stand in the config.
    """

    config: tyro.conf.Positional[Path]
    """A TOML file, or the name of one that comes with dancediff, such as tcdiffpp_small."""
    data: Path | None = None
    """A prepared folder; default: the synthetic dances that the config asks for."""
    out: Path = Path("runs/tcdiffpp")
    """Folder for checkpoint, losses and the model."""
    start: str | None = None
    """A model (name or folder) to start from; what it lacks begins untrained."""
    resume: bool = False
    """Go on from the checkpoint in the folder, if there is one."""
    overwrite: bool = False
    """Replace the training that the folder holds."""
    explain: bool = False
    """Print every key of the config: its value, its default and what it does; train nothing."""
    log: str = "csv"
    """Where numbers go besides losses.csv, which is always written: csv,tensorboard,wandb."""
    device: str = "cpu"
    """Or cuda: one GPU for each process that torchrun or accelerate starts."""
    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Train, then save the averaged model in OUT/model."""
        from dancediff import hub
        from dancediff.generation.pipeline import usable_device
        from dancediff.training.boards import check_logs
        from dancediff.training.checkpoint import load_average, read_facts
        from dancediff.training.distributed import join_world
        from dancediff.training.named_config import config_file
        from dancediff.training.run import own_class_in, train_from_config
        from dancediff.training.tables import read_training

        if self.explain:
            from dancediff.training.explained import explain_config

            print(explain_config(config_file(self.config)))
            return
        check_folder(self.out)
        log = check_logs(self.log)
        config = config_file(self.config)
        own = own_class_in(config)
        with join_world(self.device) as world:
            usable_device(world.device)
            model = train_from_config(
                config,
                self.out,
                resume=self.resume,
                overwrite=self.overwrite,
                data=self.data,
                start=None if self.start is None else hub.load(self.start, own=own).model,
                world=world,
                preview=self.preview,
                log=log,
            )
        if not world.first:
            return
        settings = config.read_text(encoding="utf-8")
        data = self.data or read_training(config).get("data", {}).get("folder")
        dances = f"the takes in {Path(data).name}" if data else "synthetic dances"
        card = f"Trained on {dances} with {config.name}:\n\n```toml\n{settings}```\n"
        folder = hub.save_model(model, self.out / "model", card=card)
        facts, lines = {"model": folder}, [f"model folder: {folder}"]
        best = self.out / "best.safetensors"
        if best.exists():
            step = read_facts(best)["step"]
            facts["best"] = hub.save_model(load_average(best, model), self.out / "best", card=card)
            lines.append(f"the best on validation, after {step} steps: {facts['best']}")
        tell(self.json, facts, lines)

    def preview(self, model, step: int) -> None:
        """Five seconds of the averaged model so far, as a filmstrip in OUT/previews."""
        from dancediff import hub
        from dancediff.generation.pipeline import pipeline_of
        from dancediff.viz.plots import save_filmstrip

        folder = self.out / "previews"
        folder.mkdir(exist_ok=True)
        song = hub.packaged_song()
        pipeline = pipeline_of(model)
        half = {"overlap": model.config.num_frames // 2}  # 75 is too long for short segments
        options = half if "overlap" in pipeline.request.names() else {}
        dancers = min(3, getattr(model.config, "max_dancers", 3))  # Lodge has no such limit
        dance = pipeline.generate(song, dancers=dancers, seconds=5, seed=0, **options)
        dance.save(folder / f"step_{step:06d}.npz")
        save_filmstrip(dance, folder / f"step_{step:06d}.png", song)


@dataclass
class Ablate:
    """Train, sample and evaluate variants of a model, and print the table."""

    config: tyro.conf.Positional[Path]
    """A TOML file, or the name of one that comes with dancediff, such as ablate_tiny."""
    out: Path = Path("runs/ablation")
    """Folder for trainings, dances and the table; what is done there is not done again."""
    devices: str = "cpu"
    """Where to train, such as cuda:0,cuda:1: a training on each, side by side."""
    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Train what is missing, dance, measure."""
        from dancediff import hub
        from dancediff.training.ablation import run_ablation
        from dancediff.training.ablation_table import mean_of_seeds, table
        from dancediff.training.named_config import config_file

        check_folder(self.out)
        devices = tuple(name.strip() for name in self.devices.split(",") if name.strip())
        config = config_file(self.config)
        rows = run_ablation(config, self.out, devices=devices, save=hub.save_model)
        tell(
            self.json,
            {"rows": rows},
            [table(mean_of_seeds(rows)), f"table: {self.out / 'results.md'}"],
        )


@dataclass
class Warm:
    """Compile librosa's inner loops once, so that the first dance does not wait for it."""

    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Compute the features of the packaged song."""
        from dancediff import hub

        song = hub.packaged_song()
        song.features()
        facts = {"song": song.name, "seconds": song.duration, "tempo": song.tempo}
        line = f"ready: {song.name!r}, {song.duration:.0f} s, {song.tempo:.0f} beats a minute"
        tell(self.json, facts, [line])


COMMANDS = {
    "generate": Generate,
    "live": Live,
    "evaluate": Evaluate,
    "gallery": Gallery,
    "study": Study,
    "convert": Convert,
    "prepare": Prepare,
    "train": Train,
    "ablate": Ablate,
    "bench-models": BenchModels,
    "warm": Warm,
    "doctor": Doctor,
}
