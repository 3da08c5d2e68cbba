"""Measure Lodge: what the tables of docs/results_lodge.md were made with.

    dancediff prepare choreograph 240 held --seconds 45 --seed 800000    # 24 takes a genre
    dancediff prepare choreograph 400 other --seconds 36 --seed 700000
    python benchmarks/lodge_bars.py equal lodge
    python benchmarks/lodge_bars.py seams lodge held
    python benchmarks/lodge_bars.py soft lodge held
    python benchmarks/lodge_bars.py feet lodge held
    python benchmarks/lodge_bars.py genre lodge TRAINING_FOLDER held
    python benchmarks/lodge_bars.py length lodge
    python benchmarks/lodge_bars.py fidelity lodge edge held other
    python benchmarks/lodge_bars.py fidelity lodge edge CMU other --kinds real --frames 512

Held-out takes are solos: of a group the first dancer. Every dance is made to the music of a
held-out take and asked for that take's genre.
"""

import time
from dataclasses import asdict, dataclass, field, replace
from unittest import mock

import joblib
import numpy as np
import roma
import torch
import tyro
from bars import Sampling
from genre_judge import shaken, trained_judge, verdict
from intervals import in_words, mean_with_interval
from tqdm.auto import tqdm

from dancediff import hub
from dancediff.bench.held_out import Window, windows
from dancediff.bench.in_processes import in_processes
from dancediff.bench.scores import loaded
from dancediff.generation.lodge_dance import LodgeSampler
from dancediff.generation.request import LodgeRequest
from dancediff.metrics.physical import fsr
from dancediff.metrics.report import evaluate_dances
from dancediff.metrics.rhythm import beat_alignment
from dancediff.motion.beats import motion_beats
from dancediff.motion.motion import Motion
from dancediff.motion.representation import LODGE, unpack
from dancediff.papers.lodge.choreography import Arrangement
from dancediff.papers.lodge.foot_refine import NoFootRefine
from dancediff.papers.lodge.model import Lodge
from dancediff.papers.lodge.segments import Segments
from dancediff.training.lodge_data import prepared_solos

FPS, LOCAL = 30, 256


def held_out(
    folder: str, frames: int, count: int, kinds: tuple[str, ...] = ("synthetic",)
) -> list[Window]:
    """Solos to their music, spread over the genres."""
    by_genre: dict[str, list[Window]] = {}
    for window in windows(folder, frames, kinds):
        if len(window.beats) > 1:
            first = Motion(window.motion.pose[:1], window.motion.root[:1], meta=window.motion.meta)
            by_genre.setdefault(window.genre, []).append(replace(window, motion=first))
    rows = zip(*(some[: 1 + count // len(by_genre)] for some in by_genre.values()), strict=False)
    return [window for row in rows for window in row][:count]


def danced(name: str, window: Window, seed: int, how: dict) -> Motion:
    """The window's music, danced by one in its genre."""
    return loaded(name).generate(window, genre=window.genre, seed=seed, **how)


def interval(values) -> str:
    """Mean and 95 % bootstrap interval over dances."""
    return in_words(*mean_with_interval(values), ".3f")


def arguments(sampling: Sampling) -> dict:
    """Of `generate`, for one who dances alone: nobody to keep apart from."""
    how = asdict(sampling)
    del how["collision_avoidance"], how["order_constraint"]
    return {name: value for name, value in how.items() if value is not None}


def solo_sampler(model: Lodge, how: dict, at_once: int | None) -> LodgeSampler:
    """Below `generate`: music features in, features of a hip-hop solo out."""
    asked = LodgeRequest(**how | {"genre": "hiphop", "at_once": at_once})
    asked = asked.resolve(model, hub.packaged_song())
    return LodgeSampler(model.global_stage, model.local_stage, asked)


@dataclass
class Common:
    """What every part is told."""

    model: tyro.conf.Positional[str]
    sampling: Sampling = field(default_factory=lambda: Sampling(steps=20, guidance=1.0))
    soft: float | None = None  # share of the way with soft cues; None: the model's default
    workers: int = 2

    @property
    def how(self) -> dict:
        """Arguments of `generate`."""
        soft = {} if self.soft is None else {"soft": self.soft}
        return arguments(self.sampling) | soft


@dataclass
class Equal(Common):
    """Does a dance depend on how many segments are danced at once?"""

    segments: tuple[int, ...] = (1, 2, 7, 16)

    def run(self) -> None:
        """Print the largest difference between all at once and one after the other, in features."""
        model = hub.load(self.model).model
        for L in self.segments:
            M = torch.randn(L * LOCAL, 35, generator=torch.Generator().manual_seed(L))
            M[:, 33:] = 0
            M[::15, 34] = 1
            made = [
                solo_sampler(model, self.how, at_once).dance(M, L * LOCAL) for at_once in (None, 1)
            ]
            print(f"| {L} | {(made[0] - made[1]).abs().max():.2e} |")


@dataclass
class Seams(Common):
    """Do seams show?"""

    held: tyro.conf.Positional[str] = "held"
    songs: int = 10
    seeds: tuple[int, ...] = (0, 1, 2)
    frames: int = 1280

    def run(self) -> None:
        """Print changes of velocity at seams and elsewhere, and the largest step of the root."""
        some = held_out(self.held, self.frames, self.songs)
        how = self.how
        jobs = [
            joblib.delayed(danced)(self.model, w, seed, how) for w in some for seed in self.seeds
        ]
        dances = in_processes(jobs, self.workers)
        at, away, speed, step = [], [], [], 0.0
        for dance in dances:
            joints = dance.joints()[0]
            change = joints.diff(n=2, dim=0).norm(dim=-1).mean(-1).numpy() * FPS  # at frames 1 ...
            seams = np.array(dance.meta["seams"])
            near = np.isin(np.arange(1, len(change) + 1), [seams - 1, seams])
            at += list(np.maximum(change[seams - 2], change[seams - 1]))
            away += list(change[~near])
            speed.append(joints.diff(dim=0).norm(dim=-1).mean().item() * FPS)
            step = max(step, dance.root.diff(dim=1).norm(dim=-1).max().item())
        truth = np.mean(
            [w.motion.joints().diff(dim=1).norm(dim=-1).mean().item() * FPS for w in some]
        )
        pairs = np.maximum(away[:-1], away[1:])  # at a seam, too, the larger of two was taken
        print(f"| change of joint velocity at {len(at)} seams, m/s | {interval(at)} |")
        print(f"| the same anywhere else | {np.mean(pairs):.3f} |")
        print(f"| ratio (bar 1.3) | {np.mean(at) / np.mean(pairs):.2f} |")
        print(f"| largest at a seam, 99.9th percentile elsewhere | {max(at):.3f}, "
              f"{np.quantile(pairs, 0.999):.3f} |")  # fmt: skip
        print(f"| largest step of the root, cm (bar 12) | {100 * step:.1f} |")
        print(f"| mean joint speed, data's | {interval(speed)}, {truth:.3f} |")


@dataclass
class Soft(Common):
    """What do soft cues do?"""

    held: tyro.conf.Positional[str] = "held"
    count: int = 30
    shares: tuple[float, ...] = (0.0, 0.5, 0.75, 1.0)

    def run(self) -> None:
        """Print beats, speed and distance to the cues for every share of guided steps."""
        some = held_out(self.held, 1024, self.count)
        print("| s | BAS | motion beats a second | joint speed, m/s | off the cues, degrees |")
        print(f"| held-out | {_rhythm((w.motion, w.beats) for w in some)} | |")
        for share in self.shares:
            how = self.how | {"soft": share}
            jobs = [joblib.delayed(near_cues)(self.model, w, k, how) for k, w in enumerate(some)]
            dances, off = zip(*in_processes(jobs, self.workers), strict=True)
            beats = (w.beats for w in some)
            print(f"| {share:g} | {_rhythm(zip(dances, beats, strict=True))} | {interval(off)} |")


def near_cues(name: str, window: Window, seed: int, how: dict) -> tuple[Motion, float]:
    """A dance, and how far its joints are turned from those of its soft cues: mean, degrees.

    Cues depend on the seed and not on how long they are held: every share is asked for the same.
    """
    found: list[tuple[Arrangement, Segments]] = []

    def keep(sampler, primitives, M, segments):
        found.append((arrange(sampler, primitives, M, segments), segments))
        return found[-1][0]

    arrange = LodgeSampler.arrange
    with mock.patch.object(LodgeSampler, "arrange", keep):
        dance = danced(name, window, seed, how)
    return dance, off_cues(dance.pose[0], *found[0])


def off_cues(pose: torch.Tensor, arrangement: Arrangement, segments: Segments) -> float:
    """Mean angle in degrees between the joints of a dance (f, 24, 3, 3) and of its soft cues.

    The root is left out: where a segment faces is decided when segments are joined.
    """
    cues = arrangement.cues()
    parts, frames = cues.soft.nonzero(as_tuple=True)
    at = frames + torch.tensor(segments.locals)[parts]
    parts, frames, at = (k[at < len(pose)] for k in (parts, frames, at))
    asked = unpack(cues.value[parts, frames], LODGE)[2]
    angle = roma.rotmat_geodesic_distance(pose[at, 1 : asked.shape[-3]], asked[:, 1:])
    return torch.rad2deg(angle).mean().item()


def _rhythm(dances) -> str:
    bas, rate, speed = [], [], []
    for dance, beats in dances:
        joints = dance.joints()
        bas.append(beat_alignment(joints, beats))
        rate.append(len(motion_beats(joints[0])) / (dance.num_frames / FPS))
        speed.append(joints.diff(dim=1).norm(dim=-1).mean().item() * FPS)
    return " | ".join(map(interval, (bas, rate, speed)))


@dataclass
class Feet(Common):
    """What does the foot refine block do? Feet are left free, so that nothing else holds them."""

    held: tyro.conf.Positional[str] = "held"
    count: int = 30

    def run(self) -> None:
        """Print foot skating with and without the block, which is taken out of the same model."""
        some = held_out(self.held, 1024, self.count)
        how = self.how | {"foot_contact": False}
        for name, refine in (("with", True), ("without", False)):
            jobs = [
                joblib.delayed(_skating)(self.model, w, k, how, refine) for k, w in enumerate(some)
            ]
            print(f"| {name} | {interval(in_processes(jobs, self.workers))} |")


def _skating(name: str, window: Window, seed: int, how: dict, refine: bool) -> float:
    stage = loaded(name).model.local_stage
    block = stage.foot_refine
    stage.foot_refine = block if refine else NoFootRefine()
    try:
        return float(fsr(danced(name, window, seed, how).joints()))
    finally:
        stage.foot_refine = block


@dataclass
class Genre(Common):
    """Is a dance of the genre that was asked for? Asked of a classifier of takes."""

    train: tyro.conf.Positional[str] = "train"
    held: tyro.conf.Positional[str] = "held"
    each: int = 10

    def run(self) -> None:
        """Print how often the classifier is right about takes it never saw, and about dances."""
        genres = hub.load(self.model).config.genres
        draw = torch.Generator().manual_seed(0)
        takes = tqdm(prepared_solos(self.train, genres), desc="training takes")
        solos = ((solo.x[0, :, : LODGE.dim], solo.genre) for solo in takes)
        judge = trained_judge(solos, draw)
        held = [(w.genre, w.motion.features("lodge")[0]) for w in held_out(self.held, 1024, 200)]
        held += [
            (solo.genre, solo.x[0, :, : LODGE.dim])
            for solo in prepared_solos(self.train, genres, "val")
            if solo.real and solo.num_frames >= LOCAL
        ]
        self._print("held-out takes", [(genre, verdict(judge, x)) for genre, x in held])
        self._print("the same, shaken", [(g, verdict(judge, shaken(x, draw))) for g, x in held])
        music = held_out(self.held, 1024, 10 * self.each)
        how = self.how
        jobs = [
            joblib.delayed(_asked_for)(self.model, music[k % len(music)], genre, k, how)
            for genre in genres
            for k in range(self.each)
        ]
        made = in_processes(jobs, self.workers)
        self._print("dances", [(genre, verdict(judge, x)) for genre, x in made])

    def _print(self, name: str, pairs: list[tuple[str, str]]) -> None:
        right = np.mean([asked == found for asked, found in pairs])
        print(f"| {name} | {100 * right:.0f} % of {len(pairs)} |")
        for genre in dict.fromkeys(asked for asked, _ in pairs):
            found = [other for asked, other in pairs if asked == genre]
            wrong = sorted({other for other in found if other != genre})
            hits = sum(other == genre for other in found)
            print(f"|  {genre} | {hits} of {len(found)} | taken for {', '.join(wrong) or '-'} |")


def _asked_for(name: str, window: Window, genre: str, seed: int, how: dict):
    dance = danced(name, replace(window, genre=genre), 1000 + seed, how)
    return genre, dance.features("lodge")[0]


@dataclass
class Length(Common):
    """How do time and memory grow with the song?"""

    frames: tuple[int, ...] = (1024, 8192)
    at_once: int = 4

    def run(self) -> None:
        """Print seconds for each length, one after the other in one process."""
        model, times = hub.load(self.model).model, []
        go = solo_sampler(model, self.how, self.at_once).dance
        go(torch.zeros(LOCAL, 35), LOCAL)  # warm
        for frames in self.frames:
            M = torch.zeros(frames, 35)
            M[::15, 34] = 1
            began = time.perf_counter()
            go(M, frames)
            times.append(time.perf_counter() - began)
            print(f"| {frames} | {times[-1]:.1f} s |")
        print(f"| ratio (bar 8.8 for 8 times the length) | {times[-1] / times[0]:.2f} |")


@dataclass
class Fidelity(Common):
    """Lodge and EDGE's naive long sampling against held-out takes."""

    edge: tyro.conf.Positional[str] = "edge"  # "none": Lodge alone
    held: tyro.conf.Positional[str] = "held"
    other: tyro.conf.Positional[str] = "other"
    frames: int = 1024
    count: int = 60
    kinds: tuple[str, ...] = ("synthetic",)  # "real": people's, not those of training
    seed: int = 0  # of the first dance; the others count on
    edge_sampling: Sampling = field(  # as in its paper, but for the number of steps
        default_factory=lambda: Sampling(steps=20, guidance=2.0, autoguidance=1.0)
    )

    def run(self) -> None:
        """Print every metric of both and of the held-out takes, against choreographed ones."""
        some = held_out(self.held, self.frames, self.count, self.kinds)
        reference = [w.motion for w in held_out(self.other, self.frames, 10 * self.count)]
        how = self.how
        sets = {"held-out": [w.motion for w in some]}
        numbered = list(enumerate(some, self.seed))
        jobs = [joblib.delayed(danced)(self.model, w, k, how) for k, w in numbered]
        sets[self.model] = in_processes(jobs, self.workers)
        if self.edge != "none":
            how = arguments(self.edge_sampling)
            jobs = [joblib.delayed(_alone)(self.edge, w, k, how) for k, w in numbered]
            sets[self.edge] = in_processes(jobs, self.workers)
        for name, dances in sets.items():
            report = evaluate_dances(dances, reference=reference, song=[w.beats for w in some])
            print(f"| {name} | " + " | ".join(map(_cell, report.rows)) + " |")
        print("| columns | " + " | ".join(row.name for row in report.rows) + " |")


def _alone(name: str, window: Window, seed: int, how: dict) -> Motion:
    return loaded(name).generate(window, dancers=1, seed=seed, **how)


def _cell(row) -> str:
    return in_words(row.value, row.low, row.high, ".3g")


if __name__ == "__main__":
    parts = (Equal, Seams, Soft, Feet, Genre, Length, Fidelity)
    tyro.extras.subcommand_cli_from_dict({part.__name__.lower(): part for part in parts}).run()
