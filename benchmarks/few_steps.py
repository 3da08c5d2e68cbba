"""What the number of steps and the place of the last guess do to dances of a bare network.

    python benchmarks/few_steps.py runs/tcdiffpp/model data/all --json-file few_steps.json

Held-out windows of a prepared folder are danced with the same noise by every sampler: no rule, no
guidance. They are compared with other held-out windows, and so is the truth.
"""

from dataclasses import dataclass
from pathlib import Path

import tyro
from result_table import write_table
from tqdm.auto import tqdm

from dancediff import hub
from dancediff.data.windows import GroupCut, WindowSampler
from dancediff.diffusion.samplers import SamplerOptions, sampling_times
from dancediff.extensions.energy_condition import has_energy_condition
from dancediff.extensions.genre_condition import genres_of
from dancediff.metrics.measure import Measured
from dancediff.metrics.rows import table_rows
from dancediff.training.config import TrainConfig
from dancediff.training.group_takes import prepared_takes
from dancediff.training.objective import GroupObjective
from dancediff.training.validation_metrics import METRICS, dance_windows, measured

SAMPLERS = ("dpm 20", "dpm 12", "dpm 12 0.16", "dpm 8 0.16", "dpm 6 0.16", "dpm 4 0.16",
            "ddim 12", "ddim 50")  # fmt: skip
DANCERS = 32  # in a batch


@dataclass
class FewSteps:
    """A row a sampler, "name steps sigma_min"; the truth is the first."""

    model: tyro.conf.Positional[str]
    data: tyro.conf.Positional[str]
    samplers: tuple[str, ...] = SAMPLERS
    batches: int = 8
    split: str = "val"  # or "train": windows that were learned from
    json_file: Path | None = None

    def run(self) -> None:
        """Dance, print and write."""
        model = hub.load(self.model).model
        windows = WindowSampler(
            prepared_takes(self.data, model.config, self.split),
            GroupCut(model.config.num_frames),
            genres=genres_of(model),
            energy=has_energy_condition(model),
            dancers_per_batch=DANCERS,
            seed=77,
        )
        to_network = GroupObjective(model, TrainConfig()).to_network
        batches = [windows.batch(k) for k in range(2 * self.batches)]
        half = self.batches
        reference = [one for batch in batches[half:] for one in measured(batch)]
        truth = [one for batch in batches[:half] for one in measured(batch)]
        rows = [["as they were danced", "", *scores(truth, reference)]]
        print(f"| sampler | guesses | {' | '.join(METRICS)} |")
        for name in self.samplers:
            options = options_of(name, model)
            dances: list[Measured] = []
            for k, batch in enumerate(tqdm(batches[:half], desc=name)):
                x = dance_windows(model, to_network(batch), k, options)
                dances += measured(batch._replace(x=x))
            times = sampling_times(options.sampler, options.steps, model.abar, options.sigma_min)
            rows.append([f"`{name}`", len(times) - 1, *scores(dances, reference)])
        for row in rows:
            cells = (str(cell[0] if isinstance(cell, list) else cell) for cell in row)
            print(f"| {' | '.join(cells)} |")
        if self.json_file is not None:
            write_table(self.json_file, self.table(rows, len(truth)))

    def table(self, rows: list[list], count: int) -> dict:
        """In the form of docs/results/*.json."""
        return {
            "about": "Samplers of a bare network on the same windows and noise: name, steps, and "
            "noise at the last guess as a share of the signal (not told: DPM-Solver++ ends at "
            "0.006).",
            "data": f"{count} windows of the recipe's data ({self.split}), compared with others",
            "seed": f"0 to {self.batches - 1}",
            "intervals": "95 % bootstrap over windows",
            "command": f"python benchmarks/few_steps.py {self.model} {self.data}",
            "columns": ["sampler", "guesses", *METRICS],
            "rows": rows,
        }


def options_of(name: str, model) -> SamplerOptions:
    """Of a row's name.

    >>> from types import SimpleNamespace
    >>> options = options_of("dpm 8 0.16", SimpleNamespace(abar=None))
    >>> options.sampler, options.steps, options.sigma_min
    ('dpm', 8, 0.16)
    """
    sampler, steps, *rest = name.split()
    sigma_min = float(rest[0]) if rest else 0.0
    return SamplerOptions(model.abar, sampler, int(steps), eta=0.0, clamp=None, sigma_min=sigma_min)


def scores(dances: list[Measured], reference: list[Measured]) -> list[list[float | None]]:
    """Value and interval of every metric, three digits of each."""
    rows = {row.name: (row.value, row.low, row.high) for row in table_rows(dances, reference)}
    return [[None if v is None else float(f"{v:.3g}") for v in rows[name]] for name in METRICS]


if __name__ == "__main__":
    tyro.cli(FewSteps).run()
