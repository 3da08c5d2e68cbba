"""What each extension brings when the packaged models dance: switched off, one at a time.

    python benchmarks/extensions.py tcdiffpp         # 8 songs of 10 s, three dancers
    python benchmarks/extensions.py tcdiffpp_swaps   # 40 songs of 8 s: do dancers change places?
    python benchmarks/extensions.py tcdiffpp_long    # 8 songs of 30 s: what acts between segments
    python benchmarks/extensions.py tcdiffpp_genres  # 20 songs of 20 s, each genre twice
    python benchmarks/extensions.py tcdiffpp_strange # 8 sounds that no training had
    python benchmarks/extensions.py lodge            # 8 songs of 34 s
    python benchmarks/extensions.py tcdiffpp --songs 1 --only speed_limit     # does it work?

Songs and seeds are fixed: the k-th song is danced with seed k, and with all extensions and without
one the same noise. Dancers of TCDiff++ are asked to change places and to end in a formation every
second time; in long dances all of them also walk along a path. What was measured is kept in --out
and not danced again. Results go to docs/results/extensions_SETTING.json. What only training has
cannot be switched off. Inputs of networks are taken away from weights that were trained with them,
which says what the weights make of them, not what a model trained without would do.
"""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import permutations
from pathlib import Path
from unittest import mock

import numpy as np
import torch
import tyro
from genre_judge import choreographed_solos, trained_judge, verdict
from kept_dances import digest_of, only_one_way
from result_table import write_table
from sklearn.pipeline import Pipeline
from torch import Tensor
from tqdm.auto import tqdm

from dancediff import hub
from dancediff.atomic import write_text
from dancediff.data.choreographer import GENRES
from dancediff.extensions import foot_contact_projection as feet
from dancediff.extensions import foot_cues
from dancediff.extensions.control import WalkAlong
from dancediff.extensions.floor_contact import AIR, flights
from dancediff.extensions.initial_frames import InitialFrames
from dancediff.extensions.parts import Part, Parts
from dancediff.extensions.registry import REGISTRY
from dancediff.extensions.speed_limit import turn_angles
from dancediff.generation.request import TCDiffPPRequest
from dancediff.metrics.bootstrap import bootstrap_interval
from dancediff.metrics.collision import tif
from dancediff.metrics.physical import fsr
from dancediff.metrics.posture import arms_wide, knee_bend, turning
from dancediff.metrics.rhythm import beat_alignment
from dancediff.metrics.swaps import obeys
from dancediff.motion.contact import TOE_CLEARANCE
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import SMPL24
from dancediff.music.features import SAMPLE_RATE
from dancediff.music.song import Music
from dancediff.music.synth import synth_song

sys.path.insert(0, str(Path(__file__).parents[1] / "docs" / "site"))

from tables import RESULTS, markdown

FIRST_SONG = 900_000  # no training saw it
PAIRED = {n for n in SMPL24.names if {"l" + n[1:], "r" + n[1:]} <= set(SMPL24.names)}
MIRRORED = [
    SMPL24.index({"l": "r", "r": "l"}[name[0]] + name[1:]) if name in PAIRED else k
    for k, name in enumerate(SMPL24.names)
]
WRISTS = [SMPL24.index(side + "wrist") for side in "lr"]
ROW, WEDGE = [(-1.2, 0.0), (0.0, 0.0), (1.2, 0.0)], [(-1.0, 0.5), (0.0, -0.5), (1.0, 0.5)]
ORDERS = list(permutations(range(3)))[1:]


@dataclass(frozen=True)
class Without:
    """How an extension is switched off: other options, or a change while dancing."""

    options: dict = field(default_factory=dict)
    change: Callable[[torch.nn.Module], AbstractContextManager] = lambda model: nullcontext()


def without_step(step: Callable) -> Without:
    """Without one of the steps of `foot_contact_hook`."""
    steps = tuple(one for one in feet.STEPS if one is not step)
    return Without(change=lambda model: mock.patch.object(feet, "STEPS", steps))


@contextmanager
def without_part(model: torch.nn.Module, name: str) -> Iterator[None]:
    """A network whose part of that name does nothing."""
    owners = [m.parts for m in model.modules() if isinstance(getattr(m, "parts", None), Parts)]
    owners = [parts for parts in owners if name in parts]
    if not owners:
        raise ValueError(f"{name!r} is no part of this model")
    before = [parts[name] for parts in owners]
    for parts in owners:
        parts[name] = Part()
    try:
        yield
    finally:
        for parts, part in zip(owners, before, strict=True):
            parts[name] = part


def no_feet(x: Tensor, normalizer) -> Tensor:
    """Foot cues that say nothing."""
    return x.new_zeros(*x.shape[:-1], foot_cues.NUM_CUES)


def patched(owner, name: str, to) -> Without:
    """Without what is called ``name``."""
    return Without(change=lambda model: mock.patch.object(owner, name, to))


def strange(k: int, seconds: float) -> tuple[Music, np.ndarray, tuple]:
    """The k-th sound that is no song: noise in bursts, ever more of them; no beats, no sections."""
    rng, n = np.random.default_rng(k), round(seconds * SAMPLE_RATE)
    time = np.arange(n) / SAMPLE_RATE
    a_second = 2.0 + 4 * k  # bursts
    burst = np.exp(-((time * a_second) % 1) * 20 / (1 + k % 3))
    gain = (np.sin(2 * np.pi * time * (k + 1) / 7) > 0) if k % 2 else 1.0  # sudden silences
    sound = rng.uniform(-1, 1, n) * burst * gain
    return Music(sound.astype(np.float32), SAMPLE_RATE, f"strange {k}"), np.array([]), ()


def synthetic(k: int, seconds: float) -> tuple[Music, np.ndarray, Sequence]:
    """The k-th song, its beats and its sections."""
    song, truth = synth_song(FIRST_SONG + k, seconds=seconds)
    return song, truth.beats, truth.sections


def group(k: int) -> dict:
    """What three dancers are asked: an order, or every second time formations."""
    asked = {"start": ROW, "end": WEDGE} if k % 2 else {"swap": ORDERS[k // 2 % len(ORDERS)]}
    return {"seed": k, "dancers": 3} | asked


def guided_group(k: int) -> dict:
    """Three dancers from a row to a wedge, the middle one to the front and back on the way."""
    path = WalkAlong(1, [(4.0, 0.0, 0.0), (7.0, 0.0, 1.2), (12.0, 0.0, 1.2), (15.0, 0.0, 0.0)])
    return {"seed": k, "dancers": 3, "start": ROW, "end": WEDGE, "constraints": (path,)}


def genre_asked(k: int) -> dict:
    """Three dancers of one genre after the other, whatever the song's tempo."""
    return {"seed": k, "dancers": 3, "genre": tuple(GENRES)[k % len(GENRES)]}


def hard_to_dance(k: int) -> dict:
    """Three dancers, pushed as far from the mean as the panels allow."""
    return {"seed": k, "dancers": 3, "guidance": 2.0, "autoguidance": 2.2}


FEET = {step.__name__: without_step(step) for step in feet.STEPS}
PARTS = {
    name: Without(change=partial(without_part, name=name))
    for name in ("formation_prior", "beat_phase", "non_local_filter")
}
CLIP = {"frequency_clip": Without({"frequency_clip": False})}
SOLVER = {"dpm_solver": Without({"sampler": "ddim"})}


@dataclass(frozen=True)
class Setting:
    """What is danced, and what is switched off."""

    model: str
    seconds: float
    off: dict[str, Without]
    request: Callable[[int], dict]
    song: Callable[[int, float], tuple[Music, np.ndarray, Sequence]] = synthetic
    songs: int = 8
    data: str = "synthetic songs that no training saw"


SETTINGS = {
    "tcdiffpp": Setting(
        "tcdiffpp",
        10.0,
        FEET
        | PARTS
        | CLIP
        | SOLVER
        | {
            "foot_cues": patched(foot_cues, "foot_cues", no_feet),
            "autoguidance": Without({"autoguidance": 1.0}),
            "collision_avoidance": Without({"collision_avoidance": False}),
        },
        group,
    ),
    "tcdiffpp_swaps": Setting(
        "tcdiffpp",
        8.0,
        {"order_constraint": Without({"order_constraint": False})},
        lambda k: {"seed": k, "dancers": 3, "swap": ORDERS[k % len(ORDERS)]},
        songs=40,
    ),
    "tcdiffpp_long": Setting(
        "tcdiffpp",
        30.0,
        {
            "initial_frames": patched(InitialFrames, "for_segment", lambda self, segment: None),
            "same_noise": Without({"pinning": "renoise"}),
            "resampled_overlap": patched(TCDiffPPRequest, "resampled", 0),
        },
        guided_group,
    ),
    "tcdiffpp_genres": Setting(
        "tcdiffpp",
        20.0,
        {"genre_guidance": Without({"genre_guidance": 1.0})},
        genre_asked,
        songs=20,
    ),
    "tcdiffpp_strange": Setting(
        "tcdiffpp",
        10.0,
        FEET | CLIP,
        hard_to_dance,
        strange,
        data="noise in bursts, guidance 2 and autoguidance 2.2",
    ),
    "lodge": Setting(
        "lodge",
        34.0,
        FEET
        | {name: PARTS[name] for name in ("beat_phase", "non_local_filter")}
        | SOLVER
        | {
            name: Without({name: False})
            for name in (
                "border_smoothing",
                "stage_spots",
                "root_stitching",
                "smooth_primitives",
                "repeat_sections",
            )
        }
        | {"autoguidance": Without({"autoguidance": 1.0})},
        lambda k: {"seed": k},
    ),
}


def measured(dance: Motion, beats: np.ndarray, sections, asked: dict) -> dict[str, float | None]:
    """Every metric of a dance; None where it says nothing."""
    joints, fps, floor = dance.joints(), dance.fps, dance.root[..., ::2]
    lowest = joints[..., 1].amin(-1) - TOE_CLEARANCE
    bend = joints.diff(n=2, dim=1).norm(dim=-1).amax((0, 2))  # of frames 1 ... F - 2
    seams = [s - 1 + o for s in dance.meta["seams"] for o in (-1, 0) if 0 <= s - 1 + o < len(bend)]
    end, swap, paths = asked.get("end"), asked.get("swap"), asked.get("constraints", ())
    missed = [
        (floor[path.dancer, round(at * fps)] - torch.tensor([x, z])).norm().item()
        for path in paths
        for at, x, z in path.points
    ]
    return {
        "FSR": fsr(joints),
        "off the floor (%)": 100 * ((lowest.abs() > AIR) & ~flights(lowest)).float().mean().item(),
        "wrists (m/s)": fps * joints[:, :, WRISTS].diff(dim=1).norm(dim=-1).mean().item(),
        "jerk (m/s3)": fps**3 * joints.diff(n=3, dim=1).norm(dim=-1).mean().item(),
        "fastest root (m/s)": fps * floor.diff(dim=1).norm(dim=-1).max().item(),
        "fastest joint (m/s)": fps * joints.diff(dim=1).norm(dim=-1).max().item(),
        "largest turn (degrees a frame)": largest_turn(dance.pose),
        "furthest (m)": floor.norm(dim=-1).max().item(),
        "knee bend (degrees)": knee_bend(joints),
        "turning (degrees/s)": turning(joints),
        "arms wide (%)": 100 * arms_wide(joints),
        "TIF (%)": 100 * tif(joints) if len(joints) > 1 else None,
        "orders kept": None if swap is None else float(obeys(dance.root, swap)),
        "end missed (m)": end and (floor[:, -1] - torch.tensor(end)).norm(dim=-1).max().item(),
        "path missed (m)": max(missed, default=None),
        "seam ratio": (bend[seams].mean() / bend.median()).item() if seams else None,
        "BAS": beat_alignment(joints, beats) if len(beats) else None,
        "MMC": beat_alignment(joints, beats, direction="motion") if len(beats) else None,
        "genre recognised": recognised(dance, asked.get("genre")),
        "sections differ (m)": sections_differ(joints, sections, fps) if len(joints) == 1 else None,
    }


@cache
def judge() -> Pipeline:
    """Knows the genre of a dance, from what the choreographer dances."""
    return trained_judge(
        choreographed_solos(range(900_000, 900_004)), torch.Generator().manual_seed(0)
    )


def recognised(dance: Motion, genre: str | None) -> float | None:
    """Is it of the genre that was asked for?"""
    return genre and float(verdict(judge(), *dance.features("lodge")) == genre)


def largest_turn(pose: Tensor) -> float:
    """How far a joint turns from a frame to the next, at most."""
    return torch.rad2deg(turn_angles(pose)).max().item()


def sections_differ(joints: Tensor, sections, fps: float) -> float | None:
    """How far joints are, relative to the pelvis, from where they were in a section's first time.

    Sections that come again mirrored are compared with the mirrored first time: the nearer counts.
    """
    pose, first, far = joints[0] - joints[0, :, :1], {}, []
    for start, stop, label in sections:
        here = pose[round(start * fps) : round(stop * fps)]
        if label in first:
            k = min(len(here), len(first[label]))
            mirrored = first[label][:k, MIRRORED] * torch.tensor([-1.0, 1.0, 1.0])
            pairs = (first[label][:k], mirrored)
            far.append(min((here[:k] - then).norm(dim=-1).mean().item() for then in pairs))
        first.setdefault(label, here)
    return float(np.mean(far)) if far else None


@dataclass
class Extensions:
    """Dance with everything and without each extension, measure, write docs/results."""

    setting: tyro.conf.Positional[str]
    songs: int | None = None
    only: tuple[str, ...] = ()
    out: Path = field(default_factory=lambda: Path("runs/extensions"))

    def run(self) -> None:
        """Dance what is missing, then print the table; write it if nothing is left out."""
        here = SETTINGS[self.setting]
        off = {name: here.off[name] for name in self.only or here.off}
        songs = self.songs or here.songs
        unknown = sorted(set(off) - set(REGISTRY))
        if unknown:
            raise SystemExit(f"not in the registry: {', '.join(unknown)}")
        variants = {"everything": Without()} | off
        how = {"model": digest_of(here.model), "seconds": here.seconds}
        only_one_way(self.out / self.setting, how)
        pipeline, bar = hub.load(here.model), tqdm(total=songs * len(variants), unit="dance")
        found: dict[str, list[dict]] = {name: [] for name in variants}
        for k in range(songs):
            song, beats, sections = here.song(k, here.seconds)
            for name, without in variants.items():
                bar.set_description(name)
                file = self.out / self.setting / f"{name}-{k}.json"
                if not file.exists():
                    asked = here.request(k)
                    with without.change(pipeline.model):
                        how = asked | without.options
                        dance = pipeline.generate(song, seconds=here.seconds, **how)
                    write_text(file, json.dumps(measured(dance, beats, sections, asked)))
                found[name].append(json.loads(file.read_text()))
                bar.update()
        bar.close()
        table = self.table(found)
        print(markdown(table))
        if not (self.only or self.songs):
            write_table(RESULTS / f"extensions_{self.setting}.json", table)

    def table(self, found: dict[str, list[dict]]) -> dict:
        """What changes without each extension, in the form of docs/results/*.json."""
        here, everything = SETTINGS[self.setting], found["everything"]
        metrics = [m for m in everything[0] if any(d[m] is not None for d in everything)]
        usual = "; ".join(f"{m} {mean([d[m] for d in everything]):.3g}" for m in metrics)
        rows = [["nothing: all values", 0, usual]]
        for name, dances in found.items():
            if name == "everything":
                continue
            pairs = list(zip(dances, everything, strict=True))
            seen = [f"{m} {step}" for m in metrics if (step := change(pairs, m))]
            rows.append([f"`{name}`", len(seen), "; ".join(seen) or None])
        return {
            "about": f"The packaged model `{here.model}` with everything, and how much metrics "
            f"change without an addition, same noise: of {len(metrics)} those whose interval does "
            "not contain 0, which happens to one in twenty by chance.",
            "data": f"{here.data}, {len(everything)} of {here.seconds:g} s",
            "seed": f"0 to {len(everything) - 1}",
            "intervals": "95 % bootstrap over songs",
            "command": f"python benchmarks/extensions.py {self.setting}",
            "columns": ["without", "metrics that change", "by"],
            "rows": rows,
        }


def mean(values: list) -> float:
    """Of those that are there."""
    return float(np.mean([value for value in values if value is not None]))


def change(pairs: list[tuple[dict, dict]], metric: str) -> str | None:
    """Mean of the differences with its interval; None where that contains 0."""
    steps = [a[metric] - b[metric] for a, b in pairs if None not in (a[metric], b[metric])]
    low, high = bootstrap_interval(np.mean, np.array(steps)) if len(steps) > 1 else (0, 0)
    return f"{mean(steps):+.3g} [{low:.2g}, {high:.2g}]" if low > 0 or high < 0 else None


if __name__ == "__main__":
    tyro.cli(Extensions).run()
