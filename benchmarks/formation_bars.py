"""Where groups stand and what their legs do, in dances against held-out ones: one table of bars.

    dancediff prepare choreograph 100 held --seconds 30 --seed 500000
    python benchmarks/drift_bars.py dances held SONG SONG ... --out runs/drift
    python benchmarks/formation_bars.py runs/drift held

Dances are the files of a folder; held-out ones are the choreographer's (synthetic), of 30 s or
more, because formations are counted in 30 s. Writes docs/results/tcdiffpp_formations.json.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np
import tyro
from intervals import mean_with_interval
from result_table import write_table
from torch import Tensor

from dancediff.data.prepared import PreparedData
from dancediff.metrics.formation import crossings, depth, formations, hull_area
from dancediff.metrics.posture import legs_tangled, standing
from dancediff.motion.motion import Motion

sys.path.insert(0, str(Path(__file__).parents[1] / "docs" / "site"))

from tables import markdown

GROUPS = {"formations in 30 s": formations, "hull area, m²": hull_area, "depth, m": depth}
GROUPS |= {"crossings in 30 s": crossings}
LEGS = {"legs crossed or ankles under 12 cm": legs_tangled, "under 5 cm in 3 s": standing}
SIZES = (3, 5)  # dancers
FEWEST = 3  # formations of five dancers
TIMES = 1.3  # the held-out share of frames or dancers


@dataclass
class Row:
    """One metric: of dances with its interval, of held-out dances with nine tenths of them."""

    name: str
    made: list[float]
    held: list[float]
    bar: str
    holds: bool

    def cells(self) -> list:
        """For the table."""
        low, high = np.quantile(self.held, (0.05, 0.95))
        made = mean_with_interval(self.made, ".3g")
        held = [float(f"{value:.3g}") for value in (np.mean(self.held), low, high)]
        return [self.name, made, held, self.bar, "yes" if self.holds else {"bold": "no"}]


def rows_of(dances: list[Tensor], truth: list[Tensor]) -> list[Row]:
    """All rows; joints (n, f, 24, 3) of every dance.

    Raises: ValueError when there are no dances of some size.
    """
    rows = []
    for n in SIZES:
        made, held = ([p for p in some if len(p) == n] for some in (dances, truth))
        if len(made) < 2 or len(held) < 2:
            raise ValueError(f"{len(made)} dances and {len(held)} held-out ones have {n} dancers")
        rows += [
            group_row(n, name, *measured(metric, made, held)) for name, metric in GROUPS.items()
        ]
    for name, metric in LEGS.items():
        values = measured(metric, dances, truth)
        most = TIMES * np.mean(values[1])
        bar = f"{TIMES:g} times the data's, {most:.3g}"
        rows.append(Row(name, *values, bar, bool(np.mean(values[0]) <= most)))
    return rows


def group_row(n: int, name: str, made: list[float], held: list[float]) -> Row:
    """A row of one size; formations of five have a bar of their own."""
    mean, (low, high) = np.mean(made), np.quantile(held, (0.05, 0.95))
    bar, holds = "within the data's 5 to 95 %", bool(low <= mean <= high)
    if n == 5 and GROUPS[name] is formations:
        bar, holds = f"at least {FEWEST}", bool(mean >= FEWEST)
    return Row(f"{n} dancers, {name}", made, held, bar, holds)


def measured(metric: Callable, *sets: list[Tensor]) -> tuple[list[float], ...]:
    """One metric of every dance of every set."""
    return tuple([float(metric(joints)) for joints in some] for some in sets)


@dataclass
class FormationBars:
    """Measure, print, write."""

    dances: tyro.conf.Positional[Path]
    held: tyro.conf.Positional[str]
    model: str = "the packaged tcdiffpp"
    results: Path = Path("docs/results")

    def run(self) -> None:
        """The table."""
        dances = [Motion.load(path).joints() for path in sorted(self.dances.glob("*.npz"))]
        data = PreparedData(self.held)
        truth = [data.load(one).motion.joints() for one in data if one.kind == "synthetic"]
        truth = [joints for joints in truth if joints.shape[1] >= 900]  # 30 s
        rows = rows_of(dances, truth)
        columns = ["metric", "dances", "held-out", "bar", "holds"]
        table = {
            "about": f"{len(dances)} dances of {self.model} to recorded songs, and "
            f"{len(truth)} of the choreographer (synthetic), 5 to 95 % of whose dances are in "
            "brackets.",
            "data": "recorded songs; held-out: synthetic",
            "intervals": "95 % bootstrap intervals over dances",
            "date": date.today().isoformat(),
            "command": "python benchmarks/formation_bars.py runs/drift HELD",
            "columns": columns,
            "rows": [row.cells() for row in rows],
        }
        write_table(self.results / "tcdiffpp_formations.json", table)
        print(markdown(table))


if __name__ == "__main__":
    tyro.cli(FormationBars).run()
