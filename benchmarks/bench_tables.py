r"""The numbers of `dancediff bench-models` as tables of the pages.

    dancediff bench-models edge_tiny gcd_tiny tcdiff_tiny tcdiffpp_tiny fact_tiny mnet_tiny \
        bailando_tiny codancers_tiny lodge_tiny --minutes 10 --data data/all --out runs/bench
    python benchmarks/bench_tables.py runs/bench --minutes 10

Writes docs/results/bench.json, papers_tcdiffpp.json and papers_lodge.json.
"""

import json
import math
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import tyro

from dancediff.bench.paper_tables import COLUMNS, paper_tables

KEYS = ("value", "low", "high")
COMMAND = "dancediff bench-models CONFIGS --minutes {:g} --data data/all --out runs/bench"


@dataclass
class BenchTables:
    """Write the tables of one run."""

    runs: tyro.conf.Positional[Path]
    minutes: float
    results: Path = Path("docs/results")

    def run(self) -> None:
        """All of them."""
        found = json.loads((self.runs / "results.json").read_text(encoding="utf-8"))
        rows, seeds = found["rows"], len({point["seed"] for point in found["points"]})
        metrics = list(rows[0]["scores"])
        body = [
            [row["variant"].split(",")[0], *(cell(row["scores"].get(name)) for name in metrics)]
            for row in rows
        ]
        about = "Systems of both papers, trained for the same processor time, bare."
        self.write("bench", about, seeds, ["system", *metrics], body)
        papers = json.loads((self.runs / "papers.json").read_text(encoding="utf-8"))
        for name, found in papers.items():
            table = paper_tables()[name]
            about = f"{table.title} ({table.data}) beside ours; only orders can be compared."
            body = [[*row[:4], cell(dict(zip(KEYS, row[4], strict=True))), row[5]] for row in found]
            self.write(f"papers_{name}", about, seeds, list(COLUMNS), body)

    def write(self, name: str, about: str, seeds: int, columns: list, rows: list) -> None:
        """One file, in the form that docs/site/tables.py reads."""
        table = {
            "about": about,
            "data": "synthetic",
            "seed": f"{seeds} of each system",
            "intervals": "from the lowest to the highest of several seeds, else 95 % bootstrap",
            "date": datetime.now(UTC).date().isoformat(),
            "command": COMMAND.format(self.minutes),
            "columns": columns,
            "rows": rows,
        }
        text = json.dumps(table, indent=1, ensure_ascii=False)
        (self.results / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def cell(score: dict | None):
    """A value with its interval, to three digits; alone where there is none, None without one.

    >>> cell({"value": 2.0, "low": 1.0, "high": 3.4567}), cell({"value": 1e6, "low": None})
    ([2.0, 1.0, 3.46], 1000000.0)
    """
    if score is None or score["value"] is None or math.isnan(score["value"]):
        return None
    numbers = [score.get(key) for key in KEYS]
    short = [None if v is None else float(f"{v:.3g}") for v in numbers]
    return short[0] if None in short else short


if __name__ == "__main__":
    tyro.cli(BenchTables).run()
