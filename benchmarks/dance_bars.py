"""Measure a model's dances against simple physical bars, without any post-processing.

    python benchmarks/dance_bars.py SONG --seconds 20 --seed 1 --dancers 1 2 3 5

Prints one row per group size. The reference row is the choreographer's dances (synthetic, what the
packaged model was trained on) from song seeds that training never saw.
"""

import time
from dataclasses import dataclass

import numpy as np
import torch
import tyro

from dancediff import hub
from dancediff.data.choreographer import choreograph
from dancediff.metrics.rhythm import beat_alignment
from dancediff.motion.beats import motion_beats
from dancediff.motion.contact import feet_low, foot_speed
from dancediff.motion.motion import Motion
from dancediff.music.song import Music
from dancediff.music.synth import synth_song

NEAR = 0.3  # metres between two roots; nearer, bodies touch
COLUMNS = [
    *[
        "seconds",
        "lowest m",
        "highest m",
        "root jump cm",
        "close %",
        "contact %",
        "low feet still %",
    ],
    *["speed m/s", "beats hit %", "off beats hit %", "BAS"],
]


@dataclass
class Args:
    """What to measure."""

    song: tyro.conf.Positional[str]
    model: str = "tcdiffpp"
    seconds: float = 20.0
    seed: int = 1
    steps: int | None = None
    """Default: the model's own."""
    guidance: float | None = None
    dancers: tuple[int, ...] = (1, 2, 3, 5)
    genre: str | None = None
    """Of Lodge."""


def hits(dance: Motion, beats: np.ndarray) -> float:
    """Share of beats with a motion beat within two frames, over all dancers, in percent."""
    found = [motion_beats(joints) for joints in dance.joints()]
    near = [len(m) > 0 and np.abs(m - beat).min() <= 2 for m in found for beat in beats]
    return 100 * float(np.mean(near))


def nearest_pair(root: torch.Tensor) -> torch.Tensor:
    """Metres on the floor between the nearest two dancers: (n, f, 3) -> (f,); inf for a solo."""
    floor = root[..., (0, 2)].transpose(0, 1)  # (f, n, 2)
    gaps = torch.cdist(floor, floor)
    gaps.diagonal(dim1=1, dim2=2).fill_(torch.inf)
    return gaps.flatten(1).amin(1)


def measure(dance: Motion, beats: np.ndarray, seconds: float) -> list[float]:
    """One row of the table; ``beats`` in frames."""
    joints = dance.joints()
    low, slow = feet_low(joints), foot_speed(joints) < 0.015
    beats = beats[beats < dance.num_frames - 2]
    half = int(np.median(np.diff(beats)) // 2)
    return [
        seconds,
        joints[..., 1].min().item(),
        joints[..., 1].max().item(),
        100 * dance.root.diff(dim=1).norm(dim=-1).max().item(),
        100 * (nearest_pair(dance.root) < NEAR).float().mean().item(),
        100 * (dance.contact > 0.5).float().mean().item(),
        100 * slow[low].float().mean().item(),
        30 * joints.diff(dim=1).norm(dim=-1).mean().item(),
        hits(dance, beats),
        hits(dance, beats[:-1] + half),
        beat_alignment(joints, beats / 30),
    ]


def main(args: Args) -> None:
    """Print the table."""
    print("| dance | " + " | ".join(COLUMNS) + " |\n|" + " --- |" * (1 + len(COLUMNS)))

    def show(name: str, row: list[float]) -> None:
        print(f"| {name} | " + " | ".join(f"{v:.3g}" for v in row) + " |", flush=True)

    rows = []
    for seed in range(100_000, 100_010):
        _, truth = synth_song(seed, seconds=args.seconds)
        dance, _ = choreograph(truth.beats, dancers=3, seed=seed, seconds=args.seconds)
        rows.append(measure(dance, np.round(truth.beats * 30), 0.0))
    show("choreographer (synthetic), mean of 10", list(np.mean(rows, axis=0)))
    song, model = Music.load(args.song), hub.load(args.model)
    song.features()
    options = {"steps": args.steps, "guidance": args.guidance, "genre": args.genre}
    options = {name: value for name, value in options.items() if value is not None}
    for n in args.dancers:
        start = time.monotonic()
        dance = model.generate(song, dancers=n, seconds=args.seconds, seed=args.seed, **options)
        spent = time.monotonic() - start
        show(f"{args.model}, {n} dancers", measure(dance, np.round(song.beats() * 30), spent))


if __name__ == "__main__":
    main(tyro.cli(Args))
