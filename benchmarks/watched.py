"""Ten dances to watch: films and filmstrips, and what numbers say about each.

    python benchmarks/watched.py SONG SONG ... --out runs/watched

Each song gets one dance of the preset, of 2, 3, 4, 5, 3 ... dancers. A dance is fine when nobody's
legs stay crossed for over a second, low feet stand in 90 % of their frames, and the group never
stands still for three seconds. What else looks wrong only somebody who watches can say.
"""

from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
import tyro
from any_song import FPS, STILL, joint_speed
from dance_bars import nearest_pair
from kept_dances import digest_of, only_one_way
from torch import Tensor
from tqdm.auto import tqdm

from dancediff import hub
from dancediff.metrics.posture import legs_crossed
from dancediff.motion.contact import feet_low, foot_speed
from dancediff.motion.motion import Motion
from dancediff.music.song import Music
from dancediff.viz.plots import save_filmstrip

SIZES = (2, 3, 4, 5, 3)  # dancers, in turn
MOVES = 0.1  # metres a second, mean over joints and dancers; below that a group stands still
COLUMNS = ("dance", "legs crossed, s", "low feet still, %", "group still, s", "nearest, m", "fine")


def longest(frames) -> float:
    """Seconds of the longest stretch of frames that are true.

    >>> longest([True] * 15 + [False] + [True] * 30)
    1.0
    """
    return max((len(list(run)) for true, run in groupby(frames) if true), default=0) / FPS


def measured(joints: Tensor) -> list[float]:
    """What is said of one dance; joints (n, f, 24, 3) in metres.

    Crossed legs are those of the dancer who crosses them longest, as `legs_crossed` has it.
    """
    crossed = [[legs_crossed(p[None]) > 0 for p in one.split(1)] for one in joints]
    still = foot_speed(joints)[feet_low(joints)] < STILL
    return [
        max(map(longest, crossed)),
        100 * still.float().mean().item(),
        longest(joint_speed(joints) < MOVES),
        nearest_pair(joints[:, :, 0]).min().item() if len(joints) > 1 else np.nan,
    ]


def fine(crossed: float, still_feet: float, still_group: float) -> bool:
    """Does a dance pass?"""
    return crossed <= 1 and still_feet >= 90 and still_group < 3


@dataclass
class Watched:
    """Dance, film, print."""

    songs: tyro.conf.Positional[tuple[Path, ...]]
    model: str = "tcdiffpp"
    seconds: float = 20.0
    seed: int = 0
    film: bool = True
    out: Path = Path("runs/watched")

    def run(self) -> None:
        """A row a song; what was danced is not danced again."""
        how = {"model": digest_of(self.model), "seconds": self.seconds, "seed": self.seed}
        only_one_way(self.out, how | {"songs": self.songs})
        model, rows = hub.load(self.model), []
        for k, path in enumerate(tqdm(self.songs, desc="dancing", unit="dance")):
            n = SIZES[k % len(SIZES)]
            file = self.out / f"{path.stem}-{n}.npz"
            if not file.exists():
                song = Music.load(path)
                seconds = min(self.seconds, song.duration)
                dance = model.generate(song, dancers=n, seconds=seconds, seed=self.seed + k)
                save_filmstrip(dance, file.with_suffix(".png"), song)
                if self.film:
                    dance.save(file.with_suffix(".mp4"), song=song)
                dance.save(file)
            rows.append((f"{path.stem}, {n}", measured(Motion.load(file).joints())))
        print("| " + " | ".join(COLUMNS) + " |\n|" + " --- |" * len(COLUMNS))
        for name, row in rows:
            said = "yes" if fine(*row[:3]) else "NO"
            print(f"| {name} | " + " | ".join(f"{value:.3g}" for value in row) + f" | {said} |")
        print(f"{sum(fine(*row[:3]) for _, row in rows)} of {len(rows)} are fine")


if __name__ == "__main__":
    tyro.cli(Watched).run()
