"""The bench of systems: one config each, trained for the same budgets, scored on the same windows.

Read first: `dancediff.bench.budget` · `dancediff.bench.stages` · `dancediff.bench.scores`.

In the output folder

    held/, reference/            windows to dance, takes to compare with, unless they are given
    SYSTEM-SEED/                 the run that branches leave
    SYSTEM-SEED/BUDGETmin/       a branch: checkpoint, model/, dances-FRAMES-STEPS-KEY/, KEY of
                                 what is danced to, point.json; or a training, if the system is
                                 trained in stages: a folder each
    SYSTEM-SEED/windows/         the same with budgets of dancer windows, BUDGETwindows/

so what is done is not done again, and a training that was stopped goes on from its checkpoint.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from dancediff import hub
from dancediff.atomic import write_text
from dancediff.axes import FPS
from dancediff.bench.baselines import BASELINES
from dancediff.bench.budget import Run, last_line
from dancediff.bench.held_out import MOST, SEGMENT, Window, chosen, windows
from dancediff.bench.scores import danced, reference_of, scores_of
from dancediff.bench.stages import StagedRun, check_config, stages_of
from dancediff.data.choreographed import choreograph_jobs
from dancediff.data.prepare import prepare
from dancediff.data.take import KINDS
from dancediff.extensions.genre_condition import genres_of
from dancediff.generation.pipeline import LodgePipeline, Pipeline
from dancediff.generation.presets import PACKAGED, PAPER
from dancediff.metrics.measure import Measured
from dancediff.motion.motion import Motion
from dancediff.papers.edge.model import start_slots
from dancediff.training.ablation_config import key_of
from dancediff.training.tables import read_training

HELD, REFERENCE = 500_000, 700_000  # the first songs of both sets; training begins at 0
METRICS = ("FID_k", "FID_g", "Div_k", "Div_g", "GMR", "GMC", "TIF", "MMC", "BAS", "PFC", "FSR")
BUDGETS = {"min": "minutes", "windows": "given_windows"}  # units, and where they are told
BARE: dict[str, Any] = {  # how all are sampled; what papers switch off is off, see bare_dance
    "sampler": "ddim",
    "eta": 0.0,
    "guidance": 1.0,
    "autoguidance": 1.0,
    "genre_guidance": 1.0,
}


def bare_dance(model: Pipeline, window: Window, seed: int, *, steps: int) -> Motion:
    """The window's music, danced by as many, without our additions to diffusion sampling.

    Networks that make a dance bit by bit decode as their packaged presets do (`keep`, `top_k`,
    `seed_noise`). As in the paper, from the likeliest units, CoDancers with ten minutes of training
    had an FID_k of 1,199 instead of 62, and Bailando 129 instead of 104 (one seed).

    Who can be asked is asked for the window's genre, and for the order in which its dancers end.
    Lodge, which makes one solo for all, makes one for each instead, as the other solo systems do.
    """
    n, off = window.motion.num_dancers, PAPER[model.request.family]
    asked = BARE | {name: False for name in off if off[name] is False} | {"steps": steps}
    names, known = model.request.names(), genres_of(model.model)
    options = {name: value for name, value in asked.items() if name in names}
    if "genre" in names and window.genre in known:
        options["genre"] = window.genre
    if "swap" in names and n > 1:
        options["swap"] = tuple(window.orders()[-1].tolist())
    if not isinstance(model, LodgePipeline) or n == 1:
        return model.generate(window, dancers=n, seed=seed, **options)
    solos = []
    for k, place in enumerate(start_slots(n)):
        alone = model.request(seed=seed).seed_of(k)
        solo = model.generate(window, dancers=1, seed=alone, **options)
        solos.append(replace(solo, root=solo.root + place))
    return Motion.side_by_side(solos)


@dataclass
class ModelBench:
    """Points of a comparison: a system, a seed and a budget each, with what its dances score.

    ``configs`` name the systems; ``held`` and ``other`` are prepared folders, by default made of
    ``songs`` synthetic dances each; ``data`` is learned from, by default what each config says.

    Raises: ValueError for two configs of one name, and for options that are empty.
    """

    configs: Sequence[Path]
    out: Path
    data: Path | None = None
    held: Path | None = None
    other: Path | None = None
    minutes: Sequence[float] = (30.0,)
    given_windows: Sequence[int] = ()  # dancer windows of further trainings
    seeds: Sequence[int] = (0, 1, 2)
    frames: Sequence[int] = (SEGMENT,)
    count: int = 60  # windows of every length
    songs: int = 100  # synthetic dances, each to its own song, in the place of held and other
    steps: int = PACKAGED["edge"]["steps"]  # of denoising
    workers: int = 1
    takes: list | None = None  # to learn from, in the place of ``data``

    def __post_init__(self):
        names = [config.stem for config in self.configs]
        if twice := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"configs {sorted(twice)} have one name; give each its own")
        for name, example in (("configs", "gcd_tiny"), ("seeds", 0), ("frames", SEGMENT)):
            if not getattr(self, name):
                raise ValueError(f"{name} is empty; name at least one, such as {example}")
        if not (self.minutes or self.given_windows):
            raise ValueError("minutes and windows are empty; name a budget, such as 30 minutes")
        if self.count < 1:
            raise ValueError(f"count={self.count} must be at least 1: so many windows are danced")

    @cached_property
    def systems(self) -> dict[str, str]:
        """The config that stands for each class of network in the papers' tables: its first."""
        first: dict[str, str] = {}
        for config in self.configs:
            name = read_training(config).get("model", {}).get("class", "TCDiffPP")
            first.setdefault(name, config.stem)
        return {config: name for name, config in first.items()}

    def points(self) -> Iterator[dict]:
        """Every point as soon as it is there, seed by seed: all systems have one before any two.

        Raises: ValueError for a config that does not fit, before anything is made, and for data
        that no dance can be scored with, before anything is trained.
        """
        for config in self.configs:
            check_config(config)
        self.check_data()
        for seed in self.seeds:
            for config in self.configs:
                kind = StagedRun if stages_of(read_training(config)) else Run
                for unit, key in BUDGETS.items():
                    folder = self.out / f"{config.stem}-{seed}" / ("" if unit == "min" else unit)
                    run = kind(config, seed, folder, self.data, self.takes, unit)
                    for budget, branch in run.models(tuple(getattr(self, key))):
                        about = {"config": config.stem, "seed": seed, key: budget}
                        yield self.point(about, branch)

    def check_data(self) -> None:
        """Make, read and measure what every system is scored with.

        Raises: ValueError naming the folder in which there is none.
        """
        for frames in self.frames:
            self.windows(frames)
        _ = self.reference

    @property
    def danced_to(self) -> dict:
        """What decides which windows are danced, and with which seeds."""
        held = None if self.held is None else str(self.held.absolute())
        return {"held": held, "songs": self.songs, "count": self.count, "frames": [*self.frames]}

    def point(self, about: dict, branch: Path) -> dict:
        """Score a model, or read what was found before with the same data and steps."""
        path = branch / "point.json"
        other = None if self.other is None else str(self.other.absolute())
        how = self.danced_to | {"other": other, "steps": self.steps}
        if path.exists():
            known = json.loads(path.read_text(encoding="utf-8"))
            if known["how"] == how:
                return known
        weights = sum(p.numel() for p in hub.load(branch / "model").model.parameters())
        found = last_line(branch) | about | {"weights": weights, "how": how, "scores": {}}
        for frames in self.frames:
            dances = self.dances(branch, frames)
            rows = scores_of(dances, self.windows(frames), self.reference, workers=self.workers)
            found["scores"][str(frames)] = {metric: rows[metric] for metric in METRICS}
        write_text(path, json.dumps(found) + "\n")
        return found

    def branch(self, point: dict) -> Path:
        """Where a point's training lies."""
        folder = self.out / f"{point['config']}-{point['seed']}"
        if "minutes" in point:
            return folder / f"{point['minutes']:g}min"
        return folder / "windows" / f"{point['given_windows']:g}windows"

    def dances(self, branch: Path, frames: int) -> list[Path]:
        """The files of a model's dances, in the order of the windows."""
        folder = branch / f"dances-{frames}-{self.steps}-{key_of(self.danced_to)}"
        dance = partial(bare_dance, steps=self.steps)
        return danced(folder, branch / "model", self.windows(frames), dance, workers=self.workers)

    @cached_property
    def baselines(self) -> list[dict]:
        """The points of dances that nobody learned; the first would be perfect."""
        points: list[dict] = [{"config": name, "scores": {}} for name in BASELINES]
        for frames in self.frames:
            some = self.windows(frames)
            for point, dances in zip(points, BASELINES.values(), strict=True):
                rows = scores_of(dances(some), some, self.reference, workers=self.workers)
                point["scores"][str(frames)] = {metric: rows[metric] for metric in METRICS}
        return points

    def windows(self, frames: int) -> list[Window]:
        """Those that every system dances.

        Raises: ValueError where there is none.
        """
        if frames not in self._windows:
            folder = self.held or self._made("held", HELD)
            some = chosen(list(windows(str(folder), frames, KINDS)), self.count)
            if not some:
                raise ValueError(
                    f"held={str(folder)!r} has no window of {frames} frames with music, a beat and "
                    f"at most {MOST} dancers, real ones outside its training split; prepare more "
                    "or longer takes with music, or ask for fewer frames"
                )
            self._windows[frames] = some
        return self._windows[frames]

    @cached_property
    def _windows(self) -> dict[int, list[Window]]:
        return {}

    @cached_property
    def reference(self) -> list[Measured]:
        """What dances are compared with, measured once."""
        folder = self.other or self._made("reference", REFERENCE)
        return reference_of(folder, workers=self.workers)

    def _made(self, name: str, seed: int) -> Path:
        """A folder of synthetic dances to songs that no training has."""
        folder = self.out / name
        seconds = max(*self.frames, SEGMENT) / FPS + 1
        jobs = choreograph_jobs(self.songs, seconds=seconds, seed=seed, varied=True)
        prepare(jobs, folder, workers=self.workers, progress=False)
        return folder
