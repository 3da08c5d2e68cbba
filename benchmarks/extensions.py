"""What each extension brings when the packaged models dance: switched off, one at a time.

    python benchmarks/extensions.py tcdiffpp                 # 8 songs of 10 s, three dancers
    python benchmarks/extensions.py lodge --seconds 17
    python benchmarks/extensions.py tcdiffpp --songs 1 --only speed_limit     # does it work?

Songs and seeds are fixed: synthetic songs, the k-th danced with seed k, and with all extensions and
without one the same noise. Dancers of TCDiff++ are asked to change places and to end in a
formation every second time. What was measured is kept in --out and not danced again. The results
of a model take their place in docs/extensions.json. What only training has cannot be switched off.
Inputs of networks are taken away from weights that were trained with them, which says what the
weights make of them, not what a model trained without would do.

Cells: the mean with everything, then for each extension how much it changes without it, with a 95 %
bootstrap interval over songs, bold where that does not contain 0.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from itertools import permutations
from pathlib import Path
from unittest import mock

import numpy as np
import torch
import tyro
from torch import Tensor
from tqdm.auto import tqdm

from dancediff import hub
from dancediff.extensions import foot_contact_projection as feet
from dancediff.extensions import foot_cues
from dancediff.extensions.floor_contact import AIR, flights
from dancediff.extensions.initial_frames import InitialFrames
from dancediff.extensions.registry import REGISTRY
from dancediff.generation.request import GroupDanceRequest
from dancediff.metrics.bootstrap import bootstrap_interval
from dancediff.metrics.collision import tif
from dancediff.metrics.physical import fsr
from dancediff.metrics.posture import arms_wide, knee_bend, turning
from dancediff.metrics.rhythm import beat_alignment
from dancediff.metrics.swaps import obeys
from dancediff.motion.contact import TOE_CLEARANCE
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import SMPL24
from dancediff.music.synth import synth_song

DOCS = Path(__file__).parents[1] / "docs"
FIRST_SONG = 900_000  # no training saw it
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
    from dancediff.extensions.parts import Part

    owners = [m.parts for m in model.modules() if name in getattr(m, "parts", ())]
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


PARTS = {
    name: Without(change=partial(without_part, name=name))
    for name in ("formation_prior", "beat_phase", "non_local_filter")
}
FEET = {step.__name__: without_step(step) for step in feet.STEPS}
OFF = {
    "tcdiffpp": FEET
    | {
        "foot_cues": patched(foot_cues, "foot_cues", no_feet),
        "autoguidance": Without({"autoguidance": 1.0}),
        "frequency_clip": Without({"frequency_clip": False}),
        "collision_avoidance": Without({"collision_avoidance": False}),
        "order_constraint": Without({"order_constraint": False}),
        "initial_frames": patched(InitialFrames, "for_segment", lambda self, segment: None),
        "same_noise": Without({"pinning": "renoise"}),
        "resampled_overlap": patched(GroupDanceRequest, "resampled", 0),
        "dpm_solver": Without({"sampler": "ddim"}),
    }
    | PARTS,
    "lodge": FEET
    | {
        "autoguidance": Without({"autoguidance": 1.0}),
        "border_smoothing": Without({"border_smoothing": False}),
        "return_to_origin": Without({"return_to_origin": False}),
        "smooth_primitives": Without({"smooth_primitives": False}),
        "repeat_sections": Without({"repeat_sections": False}),
        "dpm_solver": Without({"sampler": "ddim"}),
    }
    | {name: PARTS[name] for name in ("beat_phase", "non_local_filter")},
}


def request(model: str, k: int) -> dict:
    """What is asked of the k-th dance, beside its length."""
    if model != "tcdiffpp":
        return {"seed": k, "dancers": 1}
    asked = {"start": ROW, "end": WEDGE} if k % 2 else {"swap": ORDERS[k // 2 % len(ORDERS)]}
    return {"seed": k, "dancers": 3} | asked


def measured(dance: Motion, beats, asked: dict) -> dict[str, float | None]:
    """Every metric of a dance; None where it says nothing."""
    joints, fps = dance.joints(), dance.fps
    lowest = joints[..., 1].amin(-1) - TOE_CLEARANCE
    bend = joints.diff(n=2, dim=1).norm(dim=-1).amax((0, 2))  # of frames 1 ... F - 2
    seams = [s - 1 + o for s in dance.meta["seams"] for o in (-1, 0) if 0 <= s - 1 + o < len(bend)]
    floor = dance.root[..., ::2]
    end = asked.get("end")
    missed = None if end is None else (floor[:, -1] - torch.tensor(end)).norm(dim=-1).max().item()
    swap = asked.get("swap")
    return {
        "FSR": fsr(joints),
        "off the floor, %": 100 * ((lowest.abs() > AIR) & ~flights(lowest)).float().mean().item(),
        "wrists, m/s": fps * joints[:, :, WRISTS].diff(dim=1).norm(dim=-1).mean().item(),
        "jerk, m/s3": fps**3 * joints.diff(n=3, dim=1).norm(dim=-1).mean().item(),
        "fastest root, m/s": fps * floor.diff(dim=1).norm(dim=-1).max().item(),
        "fastest joint, m/s": fps * joints.diff(dim=1).norm(dim=-1).max().item(),
        "furthest, m": floor.norm(dim=-1).max().item(),
        "knee bend, degrees": knee_bend(joints),
        "turning, degrees/s": turning(joints),
        "arms wide, %": 100 * arms_wide(joints),
        "TIF, %": 100 * tif(joints) if len(joints) > 1 else None,
        "orders kept": None if swap is None else float(obeys(dance.root, swap)),
        "end missed, m": missed,
        "seam ratio": (bend[seams].mean() / bend.median()).item() if seams else None,
        "BAS": beat_alignment(joints, beats),
        "MMC": beat_alignment(joints, beats, direction="motion"),
    }


@dataclass
class Extensions:
    """Dance with everything and without each extension, measure, write docs/extensions.json."""

    model: tyro.conf.Positional[str]
    songs: int = 8
    seconds: float = 10.0
    only: tuple[str, ...] = ()
    out: Path = field(default_factory=lambda: Path("runs/extensions"))

    def run(self) -> None:
        """Dance what is missing, then print the table; write it if nothing was left out."""
        off = {name: OFF[self.model][name] for name in self.only or OFF[self.model]}
        unknown = sorted(set(off) - set(REGISTRY))
        if unknown:
            raise SystemExit(f"not in the registry: {', '.join(unknown)}")
        variants = {"everything": Without()} | off
        pipeline, bar = hub.load(self.model), tqdm(total=self.songs * len(variants), unit="dance")
        found: dict[str, list[dict]] = {name: [] for name in variants}
        for k in range(self.songs):
            song, truth = synth_song(FIRST_SONG + k, seconds=self.seconds)
            for name, without in variants.items():
                bar.set_description(name)
                file = self.out / f"{self.model}-{self.seconds:g}s" / f"{name}-{k}.json"
                if not file.exists():
                    asked = request(self.model, k)
                    with without.change(pipeline.model):
                        how = asked | without.options
                        dance = pipeline.generate(song, seconds=self.seconds, **how)
                    file.parent.mkdir(parents=True, exist_ok=True)
                    file.write_text(json.dumps(measured(dance, truth.beats, asked)))
                found[name].append(json.loads(file.read_text()))
                bar.update()
        bar.close()
        table = self.table(found)
        print(shown(table))
        if not self.only:
            path = DOCS / "extensions.json"
            tables = json.loads(path.read_text()) if path.exists() else {}
            tables[self.model] = table
            path.write_text(json.dumps(tables, indent=1, ensure_ascii=False) + "\n")

    def table(self, found: dict[str, list[dict]]) -> dict:
        """Rows and columns, in the form of docs/results/*.json."""
        everything, metrics = found["everything"], list(found["everything"][0])
        rows = [["everything", *(mean([d[m] for d in everything]) for m in metrics)]]
        for name, dances in found.items():
            if name != "everything":
                pairs = list(zip(dances, everything, strict=True))
                rows.append([f"without {name}", *(change(pairs, m) for m in metrics)])
        return {
            "about": f"The packaged model `{self.model}` with everything, and what changes without "
            "an extension.",
            "data": f"synthetic, {self.songs} songs of {self.seconds:g} s",
            "seed": f"songs from {FIRST_SONG} on, dances from 0 on",
            "intervals": "95 % bootstrap over songs; bold: does not contain 0",
            "command": f"python benchmarks/extensions.py {self.model} --seconds {self.seconds:g}",
            "columns": ["", *metrics],
            "rows": rows,
        }


def mean(values: list) -> float | None:
    """Of those that are there, three digits."""
    known = [value for value in values if value is not None]
    return round3(np.mean(known)) if known else None


def change(pairs: list[tuple[dict, dict]], metric: str):
    """Mean of the differences with its interval, bold where it does not contain 0."""
    steps = [a[metric] - b[metric] for a, b in pairs if None not in (a[metric], b[metric])]
    if len(steps) < 2:
        return mean(steps)
    low, high = bootstrap_interval(np.mean, np.array(steps))
    cell = [round3(v) for v in (np.mean(steps), low, high)]
    return {"bold": cell} if low > 0 or high < 0 else cell


def round3(value: float) -> float:
    """Three digits."""
    return float(f"{value:.3g}")


def shown(table: dict) -> str:
    """The table as Markdown; values only, with * where an interval does not contain 0."""

    def text(cell) -> str:
        bold = isinstance(cell, dict)
        cell = cell["bold"] if bold else cell
        cell = cell[0] if isinstance(cell, list) else cell
        return "-" if cell is None else f"{cell}{' *' * bold}"

    lines = [table["columns"], ["---"] * len(table["columns"]), *table["rows"]]
    return "\n".join(f"| {' | '.join(map(text, line))} |" for line in lines)


if __name__ == "__main__":
    tyro.cli(Extensions).run()
