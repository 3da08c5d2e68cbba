r"""The numbers of `dancediff bench-models` as tables of the pages.

    dancediff prepare cmu CMU_FOLDER data/bench --workers 2
    dancediff prepare choreograph 1500 data/bench --seconds 30 --workers 2
    dancediff bench-models edge_tiny gcd_tiny tcdiff_tiny tcdiffpp_tiny fact_tiny mnet_tiny \
        bailando_tiny codancers_tiny lodge_tiny --data data/bench --minutes 0.01 10 --seeds 0
    dancediff bench-models ... --minutes 10 --seeds 0 1 2
    python benchmarks/bench_tables.py runs/bench --minutes 10
    dancediff bench-models ... --minutes --windows 8000 --seeds 0 --out runs/bench_windows \
        --held runs/bench/held --other runs/bench/reference
    python benchmarks/bench_tables.py runs/bench_windows --windows 8000

Writes docs/results/bench.json, bench_learned.json, papers_tcdiffpp.json and papers_lodge.json;
with a number of windows bench_windows.json.
"Untrained" is a training of 0.01 minutes, a step or a few.
"""

import csv
import json
import math
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from statistics import fmean

import tyro
from result_table import write_table

from dancediff.bench.paper_tables import COLUMNS, paper_tables

KEYS = ("value", "low", "high")
COMMAND = "dancediff bench-models CONFIGS {} --seeds {} --data data/bench --out runs/{}"
UNTRAINED = 0.01  # minutes
LEARNED = ("FID_k", "FID_g", "MMC")  # what training must make better
FEW, MANY = 10, 100  # steps at the beginning and the end of a training whose loss is averaged


@dataclass
class BenchTables:
    """Write the tables of one run."""

    runs: tyro.conf.Positional[Path]
    minutes: float = 0.0
    windows: int = 0
    results: Path = Path("docs/results")

    def run(self) -> None:
        """All of them.

        Raises: ValueError without a budget, or with two.
        """
        if bool(self.minutes) == bool(self.windows):
            raise ValueError("name one budget of the run: --minutes or --windows")
        found = json.loads((self.runs / "results.json").read_text(encoding="utf-8"))
        rows, seeds = found["rows"], sorted({point["seed"] for point in found["points"]})
        metrics, seeds = list(rows[0]["scores"]), " ".join(map(str, seeds))
        body = [
            [row["variant"].split(",")[0], *(cell(row["scores"].get(name)) for name in metrics)]
            for row in rows
        ]
        if self.windows:
            about = "The same systems, trained on the same number of dancer windows."
            how = f"--minutes --windows {self.windows}", seeds
            self.write("bench_windows", about, how, ["system", *metrics], body)
            return
        about = "Systems of both papers, bare, trained for the same processor time, with the "
        about += "large pages of docs/training.md."
        how = f"--minutes {self.minutes:g}", seeds
        self.write("bench", about, how, ["system", *metrics], body)
        names = [row[0] for row in body if (self.runs / f"{row[0]}-0").exists()]
        about = "The same systems, untrained and trained: dances of one seed, and mean losses."
        columns = ["system", *(f"{name}, untrained" for name in LEARNED), *LEARNED]
        body = [self.learned(name) for name in names]
        columns += ["stage", f"loss, first {FEW} steps", f"last {MANY}", "ratio"]
        how_first = f"--minutes {UNTRAINED:g} {self.minutes:g}", "0"
        self.write(
            "bench_learned", about, how_first, columns, [row for rows in body for row in rows]
        )
        papers = json.loads((self.runs / "papers.json").read_text(encoding="utf-8"))
        for name, found in papers.items():
            table = paper_tables()[name]
            about = f"{table.title} ({table.data}) beside ours; only orders can be compared."
            body = [[*row[:4], cell(dict(zip(KEYS, row[4], strict=True))), row[5]] for row in found]
            self.write(f"papers_{name}", about, how, list(COLUMNS), body)

    def learned(self, system: str) -> list[list]:
        """Rows of what the training with seed 0 brought, one for each of its stages."""
        branch = self.runs / f"{system}-0" / f"{self.minutes:g}min"
        known = [scores(branch.with_name(f"{UNTRAINED:g}min")), scores(branch)]
        cells = [cell(dict(zip(KEYS, one[name], strict=True))) for one in known for name in LEARNED]
        rows = []
        for number, file in enumerate(sorted(branch.glob("**/losses.csv"), key=order_of)):
            stage = "" if file.parent in (branch, branch / "train") else file.parent.name
            first, last = ends(file)
            losses = [digits(value) for value in (first, last, last / first)]
            before = [""] * (1 + len(cells)) if number else [system, *cells]
            rows.append([*before, stage, *losses])
        return rows

    def write(self, name: str, about: str, how: tuple[str, str], columns: list, rows: list):
        """One file, in the form that docs/site/tables.py reads; ``how``: budget, seeds."""
        table = {
            "about": about,
            "data": "synthetic windows; trainings had motion capture, too",
            "seed": how[1],
            "intervals": "from the lowest to the highest of several seeds, else 95 % bootstrap",
            "date": datetime.now(UTC).date().isoformat(),
            "command": COMMAND.format(*how, "bench_windows" if self.windows else "bench"),
            "columns": columns,
            "rows": rows,
        }
        write_table(self.results / f"{name}.json", table)


def scores(branch: Path) -> dict[str, list]:
    """What dances of a network scored."""
    point = json.loads((branch / "point.json").read_text(encoding="utf-8"))
    return next(iter(point["scores"].values()))


def order_of(file: Path) -> float:
    """When a stage was trained."""
    return (file.parent / "spent.jsonl").stat().st_mtime


def ends(file: Path) -> tuple[float, float]:
    """Mean training loss at the beginning and at the end."""
    with file.open(encoding="utf-8", newline="") as lines:
        losses = [float(row["total"]) for row in csv.DictReader(lines)]
    return fmean(losses[:FEW]), fmean(losses[-MANY:])


def cell(score: dict | None):
    """A value with its interval, to three digits; alone where there is none, None without one.

    >>> cell({"value": 2.0, "low": 1.0, "high": 3.4567}), cell({"value": 1e6, "low": None})
    ([2, 1, 3.46], 1000000)
    """
    if score is None or score["value"] is None or math.isnan(score["value"]):
        return None
    numbers = [score.get(key) for key in KEYS]
    short = [None if v is None else digits(v) for v in numbers]
    return short[0] if None in short or short[1] == short[2] else short


def digits(value: float) -> float:
    """Three of them."""
    short = float(f"{value:.3g}")
    return int(short) if short.is_integer() else short


if __name__ == "__main__":
    tyro.cli(BenchTables).run()
