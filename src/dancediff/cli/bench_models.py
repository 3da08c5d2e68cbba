"""`dancediff bench-models`: systems trained for the same computing, and what their dances score."""

import json
from dataclasses import dataclass
from pathlib import Path

import tyro

from dancediff.atomic import write_text
from dancediff.cli.files import check_folder, tell
from dancediff.generation.presets import PACKAGED


@dataclass
class BenchModels:
    """Train systems for the same computing and compare their dances of the same windows.

    A run that was stopped goes on. Budgets are minutes of processor time, and windows.
    """

    configs: tyro.conf.Positional[tuple[Path, ...]]
    """A training config for each system, such as edge_tiny bailando_tiny tcdiffpp_tiny."""
    out: Path = Path("runs/bench")
    """Folder for trainings, dances, results.json, results.md and pictures."""
    minutes: tuple[float, ...] = (30.0,)
    """Budgets of every training."""
    windows: tuple[int, ...] = ()
    """Numbers of dancer windows, each a training of its own beside those by time."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Trainings of every system; intervals go from the lowest to the highest of them."""
    data: Path | None = None
    """A prepared folder to learn from; default: what each config says."""
    held: Path | None = None
    """A prepared folder whose windows are danced; default: synthetic songs."""
    other: Path | None = None
    """A prepared folder to compare dances with; default: other synthetic songs."""
    frames: tuple[int, ...] = (150,)
    """Lengths of the windows."""
    count: int = 60
    """Windows of each length."""
    songs: int = 100
    """Synthetic songs of the windows, a dance to each, and as many to compare with."""
    steps: int = PACKAGED["edge"]["steps"]
    """Denoising steps."""
    workers: int = 1
    """Processes that dance and measure; training has one."""
    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Train what is missing, dance, score; the table is written anew after every point."""
        from dancediff.bench.model_bench import ModelBench
        from dancediff.training.ablation_table import table
        from dancediff.training.named_config import config_file

        check_folder(self.out)
        same = ("minutes", "seeds", "data", "held", "other", "frames", "count", "songs", "steps")
        bench = ModelBench(
            [config_file(config) for config in self.configs],
            self.out,
            workers=self.workers,
            given_windows=self.windows,
            **{name: getattr(self, name) for name in same},
        )
        points, rows = [], []
        for point in bench.points():
            points.append(point)
            rows = self.write(points, bench)
        self.draw(points, bench)
        lines = [table(rows), *self.papers(points, bench), f"table: {self.out / 'results.md'}"]
        tell(self.json, {"rows": rows, "results": self.out / "results.json"}, lines)

    def write(self, points: list[dict], bench) -> list[dict]:
        """The table of the points so far; returns its rows."""
        from dancediff.bench.results import rows_of
        from dancediff.training.ablation_table import table

        rows = rows_of([*points, *bench.baselines])
        facts = {"points": points, "rows": rows}
        write_text(self.out / "results.json", json.dumps(facts, indent=1) + "\n")
        write_text(self.out / "results.md", table(rows))
        return rows

    def papers(self, points: list[dict], bench) -> list[str]:
        """The papers' tables beside the largest budget and the first length; written, too."""
        from dancediff.bench.paper_tables import markdown, paper_tables, papers_beside

        minutes, frames = max(self.minutes, default=0.0), self.frames[0]
        rows, texts = papers_beside(points, bench.systems, minutes, frames), []
        for name, some in rows.items():
            table = paper_tables()[name]
            here = f"here {minutes:g} min of training, {self.count} windows of {frames} frames"
            texts.append(f"{table.title} ({table.data}; {here})\n\n{markdown(some)}")
        write_text(self.out / "papers.json", json.dumps(rows, indent=1) + "\n")
        write_text(self.out / "papers.md", "\n".join(texts))
        return texts

    def draw(self, points: list[dict], bench) -> None:
        """Quality against computing, and a filmstrip a system: of the first window and seed."""
        from dancediff.bench.baselines import TRUTH
        from dancediff.bench.model_bench import METRICS
        from dancediff.bench.pictures import draw_quality, draw_strips
        from dancediff.motion.motion import Motion

        draw_quality(points, METRICS, self.out / "quality.png")
        frames = self.frames[0]
        strips = {TRUTH: bench.windows(frames)[0].motion}
        for point in points:  # the largest budget comes last
            if point["seed"] == self.seeds[0]:
                file = bench.dances(bench.branch(point), frames)[0]
                strips[point["config"]] = Motion.load(file)
        draw_strips(strips, self.out / "filmstrips.png")
