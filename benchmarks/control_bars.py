"""Measure how well constraints hold, and whether the dance around them stays a dance.

    python benchmarks/control_bars.py --seeds 8

Prints one row per kind of control: mean and worst over seeds. "skating" is the foot skating ratio
within 30 frames of what was asked for, minus that of the same frames of the free dance (same seed).
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
import tyro

from dancediff import hub
from dancediff.extensions.control import EndAt, Keep, StartAt, WalkAlong, combine
from dancediff.metrics.physical import fsr
from dancediff.metrics.swaps import obeys
from dancediff.motion.motion import Motion
from dancediff.motion.representation import TCDIFFPP, unpack
from dancediff.motion.rotation import rotation_angle

NEAR = 30  # frames
NAMES = ("start", "end", "path of one dancer", "in between", "upper body", "one dancer")
SWAP = [1, 0, 2]
FIRST, LAST = [(-1.2, 0.3), (0.2, -0.4), (1.0, 0.6)], [(-1.0, 0.0), (0.1, 0.8), (1.1, 0.2)]


@dataclass
class Args:
    """What to measure."""

    model: str = "tcdiffpp"
    seconds: float = 5.0
    seeds: int = 4
    steps: int = 12
    dancers: int = 3


def kinds(other: Motion, seconds: float) -> dict[str, list]:
    """The constraints of every row; ``other`` is a dance to keep parts of."""
    x, _, z = other.root[1, 0].tolist()
    path = [(0, x, z), (seconds / 2, x + 0.6, z + 0.4), (seconds, x, z + 0.8)]
    controls = [
        [StartAt(FIRST)],
        [EndAt(LAST)],
        [WalkAlong(1, path)],
        [Keep(other, seconds=[(0, 1), (seconds - 1, seconds)])],
        [Keep(other, joints="upper body")],
        [Keep(other, dancers=[0])],
    ]
    return dict(zip(NAMES, controls, strict=True))


def errors(held: Motion, controls: list) -> tuple[float, float, torch.Tensor]:
    """Largest error in cm and degrees of what was asked for; the frames where something was."""
    asked = combine(controls, held.num_dancers, held.num_frames, held.fps)
    x, mask = held.features(), asked.mask
    place = mask[..., TCDIFFPP.root] * (x - asked.value)[..., TCDIFFPP.root]
    kept = mask[..., TCDIFFPP.rot6d].unflatten(-1, (24, 6)).all(-1)
    degrees = 0.0
    if kept.any():
        R, R_asked = (unpack(part)[2][kept] for part in (x, asked.value))
        degrees = torch.rad2deg(rotation_angle(R.mT @ R_asked)).max().item()
    return 100 * place.norm(dim=-1).max().item(), degrees, mask.flatten(2).any(-1).any(0)


def near(frames: torch.Tensor) -> torch.Tensor:
    """Frames within `NEAR` of those."""
    wide = torch.nn.functional.max_pool1d(frames.float()[None], 2 * NEAR + 1, 1, NEAR)[0]
    return wide.bool()


def row(dance_with, frees: list[Motion], others: list[Motion], name: str) -> dict[str, list[float]]:
    """All seeds of one kind of control."""
    found: dict[str, list[float]] = {"cm": [], "degrees": [], "jump": [], "skating": []}
    for seed, (free, other) in enumerate(zip(frees, others, strict=True)):
        controls = kinds(other, other.num_frames / other.fps)[name]
        held = dance_with(seed=seed, constraints=controls)
        cm, degrees, frames = errors(held, controls)
        around = near(frames)
        found["cm"].append(cm)
        found["degrees"].append(degrees)
        found["jump"].append(100 * held.root.diff(dim=1).norm(dim=-1).max().item())
        skates = [100 * fsr(dance.joints()[:, around]) for dance in (held, free)]
        found["skating"].append(skates[0] - skates[1])
    return found


def main(args: Args) -> None:
    """Print the table."""
    dance_with = partial(
        hub.load(args.model).generate,
        hub.packaged_song(),
        dancers=args.dancers,
        seconds=args.seconds,
        steps=args.steps,
    )
    seeds = range(args.seeds)
    free, others = ([dance_with(seed=k + first) for k in seeds] for first in (0, 1000))
    print("| control | error cm | error degrees | root jump cm | skating, points |")
    print("| --- | --- | --- | --- | --- |")
    for name in NAMES:
        found = row(dance_with, free, others, name)
        cells = [f"{np.mean(v):.2f}, at worst {np.max(v):.2f}" for v in found.values()]
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)
    hits = sum(obeys(dance_with(seed=k, swap=SWAP).root, SWAP) for k in seeds)
    print(f"swap {SWAP}: {hits} of {args.seeds} dances end in that order")


if __name__ == "__main__":
    main(tyro.cli(Args))
