r"""Which system hears the beat? MMC with the song's beats, and with beats between them.

    dancediff bench-models ... --minutes 0.01 10 --seeds 0
    python benchmarks/heard_beats.py runs/bench --minutes 10

Some motion beats lie near any beat, and a body that trembles has many, so MMC of a network that
learned nothing is not 0. Only the difference from the same dances with shifted beats is hearing.
Writes docs/results/bench_heard.json from the dances of a run, and dances nothing itself.

Symbols (axes: n dancers · f frames · j joints)
    joints   of a dance, metres   (n, f, j, 3)
"""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import tyro
from intervals import Interval, mean_with_interval
from result_table import write_table
from torch import Tensor

from dancediff.bench.held_out import SEGMENT, Window, chosen, windows
from dancediff.metrics.rhythm import beat_alignment
from dancediff.motion.motion import Motion

SHIFTS = (0.25, 0.5, 0.75)  # of the interval between two beats
UNTRAINED = 0.01  # minutes
COLUMNS = ["MMC", "beats shifted", "difference"]


@dataclass
class HeardBeats:
    """Count beats in the dances of one run, of its first seed."""

    runs: tyro.conf.Positional[Path]
    minutes: float
    count: int = 60  # windows, as in the run
    results: Path = Path("docs/results")

    def run(self) -> None:
        """A row for the held-out dances and for each system, untrained and trained."""
        some = chosen(list(windows(str(self.runs / "held"), SEGMENT)), self.count)
        truth = row_of([heard(w.motion.joints(), w.beats) for w in some])
        rows = [["held-out dances", *[""] * len(COLUMNS), *truth]]
        for system in sorted(self.runs.glob("*-0")):
            cells = [
                cell
                for minutes in (UNTRAINED, self.minutes)
                for cell in row_of([*self.scores(system / f"{minutes:g}min", some)])
            ]
            rows.append([system.name.removesuffix("-0"), *cells])
        table = {
            "about": "MMC with the song's beats, and with beats between them (mean of three).",
            "data": "synthetic windows; trainings had motion capture, too",
            "seed": "0",
            "intervals": "95 % bootstrap over dances",
            "date": datetime.now(UTC).date().isoformat(),
            "command": f"python benchmarks/heard_beats.py runs/bench --minutes {self.minutes:g}",
            "columns": ["system", *(f"{name}, untrained" for name in COLUMNS), *COLUMNS],
            "rows": rows,
        }
        write_table(self.results / "bench_heard.json", table)
        for row in rows:
            print(*row)

    def scores(self, branch: Path, some: list[Window]) -> Iterator[tuple[float, float]]:
        """Of every dance of a training, in the order of the windows."""
        (folder,) = branch.glob(f"dances-{SEGMENT}-*")
        for window in some:
            yield heard(Motion.load(folder / f"{window.name}.npz").joints(), window.beats)


def heard(joints: Tensor, beats: np.ndarray) -> tuple[float, float]:
    """MMC, and the same with beats a quarter, half and three quarters of an interval later."""
    step = np.median(np.diff(beats)) if len(beats) > 1 else 0.5
    own, *shifted = (
        beat_alignment(joints, beats + share * step, direction="motion") for share in (0, *SHIFTS)
    )
    return own, float(np.mean(shifted))


def row_of(scores: list[tuple[float, float]]) -> list[Interval]:
    """Mean and interval of both and of their difference."""
    own, shifted = np.array(scores).T
    return [mean_with_interval(x, ".3f") for x in (own, shifted, own - shifted)]


if __name__ == "__main__":
    tyro.cli(HeardBeats).run()
