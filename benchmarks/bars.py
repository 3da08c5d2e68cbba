"""Measure a model on held-out dances: what the tables of docs/results_tcdiffpp.md were made with.

    dancediff prepare cmu CMU_FOLDER held                      # its composed takes count, too
    dancediff prepare choreograph 200 held --seconds 25 --seed 500000
    dancediff prepare choreograph 400 other --seconds 25 --seed 700000
    python benchmarks/bars.py dances tcdiffpp held other --frames 150 --count 1050
    python benchmarks/bars.py swaps tcdiffpp other
    python benchmarks/bars.py music tcdiffpp SONG SONG SONG SONG SONG
    python benchmarks/bars.py memory runs/bars/tcdiffpp-150 TRAINING_FOLDER held

Every held-out window is danced again: to its music, by as many dancers, who are asked for the
left-to-right orders that its own dancers took. So both sets agree in group sizes, genres and
changes of place. What was danced is kept in --out and not danced again.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from itertools import permutations
from pathlib import Path
from unittest import mock

import joblib
import numpy as np
import torch
import tyro
from dance_bars import NEAR, nearest_pair
from intervals import in_words, mean_with_interval
from kept_dances import digest_of, only_one_way
from tqdm.auto import tqdm

from dancediff.atomic import write_text
from dancediff.bench.held_out import SEGMENT, Window, chosen, windows
from dancediff.bench.in_processes import in_processes
from dancediff.bench.scores import loaded
from dancediff.data.prepared import PreparedData
from dancediff.generation.pipeline import EDGEPipeline, Pipeline
from dancediff.generation.request import default_of
from dancediff.generation.segments import SegmentPlan
from dancediff.metrics.fidelity import fid
from dancediff.metrics.kinetic import kinetic_features
from dancediff.metrics.report import evaluate_dances
from dancediff.metrics.rhythm import beat_alignment
from dancediff.metrics.swaps import obeys, permutation_kind
from dancediff.motion.motion import Motion
from dancediff.music.song import Music


@dataclass
class Sampling:
    """How to dance, the same for all models of a table."""

    sampler: str = default_of("tcdiffpp", "sampler")
    steps: int = default_of("tcdiffpp", "steps")
    eta: float = default_of("tcdiffpp", "eta")
    guidance: float = default_of("tcdiffpp", "guidance")
    autoguidance: float | None = None
    autoguidance_end: float | None = None
    sigma_min: float | None = None
    foot_contact: bool | None = None
    collision_avoidance: bool | None = None
    order_constraint: bool | None = None
    frequency_clip: bool | None = None

    def of(self, model: Pipeline) -> dict:
        """The options that are given, as far as the model has them."""
        names = model.request.names()
        return {k: v for k, v in asdict(self).items() if v is not None and k in names}


def dance(model: Pipeline, window: Window, *, seed: int, naive: bool, sampling: Sampling) -> Motion:
    """The window's music, danced by as many; a group model is asked for the window's orders."""
    options = {"dancers": window.motion.num_dancers, "seed": seed} | sampling.of(model)
    if isinstance(model, EDGEPipeline):
        return model.generate(window, **options)
    # not one order at the end, as a request has it, but one for every segment
    orders = [order.tolist() for order in window.orders()]
    with mock.patch.object(SegmentPlan, "targets", lambda self, request: orders):
        return model.generate(window, long_sampling="naive" if naive else "lgds", **options)


def _dance_to(path: Path, model: str, window: Window, **how) -> None:
    motion = dance(loaded(model), window, **how)
    motion.meta["kind"] = "generated"
    motion.save(path)


@dataclass
class Dances:
    """Dance held-out windows again and compare with them and with other takes."""

    model: tyro.conf.Positional[str]
    held: tyro.conf.Positional[str]
    other: tyro.conf.Positional[str]
    frames: int = 150
    count: int = 1050
    kinds: tuple[str, ...] = ("synthetic", "composed")
    seeds: tuple[int, ...] = (0, 1, 2)  # every window is danced with one of them, in turn
    naive: bool = False
    sampling: Sampling = field(default_factory=Sampling)
    workers: int = 2
    out: Path = Path("runs/bars")

    def run(self) -> None:
        """Print what the dances and the held-out windows score, side by side; fidelity by seed."""
        todo = chosen(list(windows(self.held, self.frames, self.kinds)), self.count)
        name = f"{Path(self.model).name}-{self.frames}{'-naive' * self.naive}"
        name += "-free" * (self.sampling.foot_contact is False)
        name += "" if "synthetic" in self.kinds else "-" + "-".join(self.kinds)
        folder = self.out / name
        made_of = {"model": digest_of(self.model), "held": str(Path(self.held).resolve())}
        only_one_way(folder, asdict(self.sampling) | {"seeds": list(self.seeds)} | made_of)
        files = [folder / f"{window.name}.npz" for window in todo]
        how = {"sampling": self.sampling, "naive": self.naive}
        seeds = [self.seeds[k % len(self.seeds)] for k in range(len(todo))]
        jobs = [
            joblib.delayed(_dance_to)(path, self.model, window, seed=seed * 100_003 + k, **how)
            for k, (path, window, seed) in enumerate(zip(files, todo, seeds, strict=True))
            if not path.exists()
        ]
        in_processes(jobs, self.workers)
        rows = self.compare(files, todo)
        rows.append(room([Motion.load(file) for file in files], [w.motion for w in todo]))
        for row in rows:
            made, held = (in_words(*row[of]) for of in ("made", "held-out"))
            print(f"| {row['metric']} | {made} | {held} |")
        other = PreparedData(self.other)
        known = _kinetic(other.load(entry).motion for entry in other)
        by_seed = {}
        for seed in self.seeds:
            part = [k for k, drawn in enumerate(seeds) if drawn == seed]
            made, held = (
                fid(_kinetic(some), known)
                for some in ((Motion.load(files[k]) for k in part), (todo[k].motion for k in part))
            )
            by_seed[seed] = made, held
            print(f"| FID_k, seed {seed} | {made:.4g} | {held:.4g} |")
        facts = {
            "windows": len(todo),
            "dancers": sum(window.motion.num_dancers for window in todo),
            "sampling": asdict(self.sampling),
            "rows": rows,
            "FID_k by seed": by_seed,
        }
        write_text(self.out / f"{name}.json", json.dumps(facts) + "\n")

    def compare(self, files: list[Path], todo: list[Window]) -> list[dict]:
        """What the dances and their windows score, with intervals: a row a metric."""
        beats = [window.beats for window in todo]
        options = {"reference": self.other, "song": beats, "window": min(self.frames, SEGMENT)}
        made = evaluate_dances(files, **options, workers=self.workers, progress=True)
        truth = evaluate_dances([w.motion for w in todo], **options, workers=self.workers)
        return [
            {
                "metric": ours.name,
                "made": [ours.value, ours.low, ours.high],
                "held-out": [theirs.value, theirs.low, theirs.high],
            }
            for ours, theirs in zip(made.rows, truth.rows, strict=True)
        ]


def room(made: list[Motion], held: list[Motion]) -> dict:
    """Share of frames of groups with nobody nearer to another than 30 cm, as a row."""
    row: dict = {"metric": "nobody under 30 cm"}
    for name, some in {"made": made, "held-out": held}.items():
        groups = [motion for motion in some if motion.num_dancers > 1]
        row[name] = mean_with_interval(
            [(nearest_pair(one.root) >= NEAR).double().mean().item() for one in groups]
        )
    return row


def _kinetic(motions: Iterable[Motion]) -> torch.Tensor:
    """Kinetic features of every dancer in every whole window of 150 frames."""
    rows = []
    for motion in motions:
        pieces = motion.joints().split(SEGMENT, dim=1)
        rows += [kinetic_features(piece) for piece in pieces if piece.shape[1] == SEGMENT]
    return torch.cat(rows)


@dataclass
class Swaps:
    """Ask dancers for every order equally often."""

    model: tyro.conf.Positional[str]
    held: tyro.conf.Positional[str]
    dancers: int = 3
    each: int = 20
    seed: int = 0
    sampling: Sampling = field(default_factory=Sampling)
    workers: int = 2

    def run(self) -> None:
        """Print how many end in the order that was asked for; of three by kind of order, too."""
        orders = list(permutations(range(self.dancers)))
        songs = chosen(list(windows(self.held, SEGMENT, ("synthetic",))), len(orders) * self.each)
        asked = [orders[k % len(orders)] for k in range(len(songs))]
        jobs = [
            joblib.delayed(_obeys)(self.model, song, order, self.seed + k, self.sampling)
            for k, (song, order) in enumerate(zip(songs, asked, strict=True))
        ]
        hits = in_processes(jobs, self.workers, label="swapping")
        for name, kept in by_order(asked, hits).items():
            print(f"| {name} | {sum(kept)} | {len(kept)} |")


def by_order(orders: list[tuple[int, ...]], hits: list[bool]) -> dict[str, list[bool]]:
    """Hits of all dances, and of trios by order and by kind of order.

    >>> by_order([(0, 1), (1, 0), (0, 1)], [True, False, True])
    {'all': [True, False, True]}
    >>> {name: sum(kept) for name, kept in by_order([(0, 1, 2), (2, 0, 1)], [True, True]).items()}
    {'all': 2, '0 1 2': 1, 'identity': 1, '2 0 1': 1, 'rotation': 1}
    """
    found: dict[str, list[bool]] = {"all": [*hits]}
    for order, hit in zip(orders, hits, strict=True):
        if len(order) == 3:
            for name in (" ".join(map(str, order)), permutation_kind(order)):
                found.setdefault(name, []).append(hit)
    return found


def _obeys(model: str, song: Window, order, seed: int, sampling: Sampling) -> bool:
    ready = loaded(model)
    options = {"seed": seed, "swap": order} | sampling.of(ready)
    return obeys(ready.generate(song, dancers=len(order), **options).root, order)


@dataclass
class Songs:
    """Does the music matter? Dances to real songs against their own beats and other beats."""

    model: tyro.conf.Positional[str]
    songs: tyro.conf.Positional[tuple[str, ...]]
    seconds: float = 20.0
    dancers: int = 3
    seeds: tuple[int, ...] = (0, 1)
    sampling: Sampling = field(default_factory=Sampling)
    workers: int = 2

    def run(self) -> None:
        """Print MMC with its own beats, shifted beats, and the beats of the other songs."""
        jobs = [
            joblib.delayed(_to_song)(self.model, s, self.seconds, self.dancers, seed, self.sampling)
            for s in self.songs
            for seed in self.seeds
        ]
        found = in_processes(jobs, self.workers)
        beats = {song: times for song, _, times in found}
        own, shifted, others = [], [], []
        for song, joints, times in found:
            period = np.median(np.diff(times))
            ways = [
                beat_alignment(joints, times + part * period, direction="motion")
                for part in (0, 0.25, 0.5, 0.75)
            ]
            rest = [
                beat_alignment(joints, b, direction="motion") for s, b in beats.items() if s != song
            ]
            own.append(ways[0])
            shifted.append(np.mean(ways[1:]))
            others.append(np.mean(rest))
            print(
                f"| {Path(song).stem} | {60 / period:.0f} | {own[-1]:.3f} | {shifted[-1]:.3f} "
                f"| {others[-1]:.3f} |"
            )
        print(
            f"| all | | {np.mean(own):.3f} | {np.mean(shifted):.3f} | {np.mean(others):.3f} | "
            f"own / shifted {np.mean(own) / np.mean(shifted):.3f}"
        )


def _to_song(model: str, song: str, seconds: float, dancers: int, seed: int, sampling: Sampling):
    music = Music.load(song)
    ready = loaded(model)
    options = {"dancers": dancers, "seconds": seconds, "seed": seed} | sampling.of(ready)
    made = ready.generate(music, **options)
    return song, made.joints(), np.asarray(music.beats())


@dataclass
class Memory:
    """Are dances copies of what was learned? Distances to the nearest training window."""

    made: tyro.conf.Positional[str]
    trained: tyro.conf.Positional[str]
    held: tyro.conf.Positional[str]

    def run(self) -> None:
        """Print quantiles of the distance to the nearest, of the dances and of held-out takes."""
        learned = windows(self.trained, SEGMENT, ("synthetic",), step=30)
        known = _described(window.motion for window in learned)
        sets = {
            "made": _described(map(Motion.load, sorted(Path(self.made).glob("*.npz")))),
            "held-out": _described(w.motion for w in windows(self.held, SEGMENT, ("synthetic",))),
        }
        scale = known.std(0).clamp_min(1e-6)
        for name, some in sets.items():
            nearest = torch.cdist(some / scale, known / scale).amin(1)
            low, middle, high = nearest.quantile(nearest.new_tensor([0.05, 0.5, 0.95])).tolist()
            print(f"| {name} | {len(some)} | {low:.2f} | {middle:.2f} | {high:.2f} |")


def _described(motions) -> torch.Tensor:
    """A dancer of a window: kinetic features, and joints seen from the pelvis at 2 Hz."""
    rows = []
    for motion in tqdm(motions, desc="reading"):
        joints = motion.joints()[:, :SEGMENT]
        seen = (joints[:, ::15] - joints[:, ::15, :1]).flatten(1)
        rows.append(torch.cat([kinetic_features(joints), seen], dim=1))
    return torch.cat(rows)


if __name__ == "__main__":
    parts = {"dances": Dances, "swaps": Swaps, "music": Songs, "memory": Memory}
    tyro.extras.subcommand_cli_from_dict(parts).run()
