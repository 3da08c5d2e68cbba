"""Metrics of dances while a network is trained: what the validation loss cannot see.

Read first: `dancediff.training.evaluator` · docs/metrics.md.

The network dances held-out windows, bare: no hook, no guidance. Another set of held-out windows is
what its dances are compared with.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    x    motion of windows, metres         (b, n, f, d)
"""

import csv
from functools import cached_property
from pathlib import Path
from typing import cast

import torch
from torch import Tensor

from dancediff.atomic import atomic_write
from dancediff.data.windows import Batch
from dancediff.diffusion.conditions import Conditions, Denoiser
from dancediff.diffusion.guidance import guided
from dancediff.diffusion.samplers import SamplerOptions, sample
from dancediff.metrics.measure import Measured, measure
from dancediff.metrics.rows import table_rows
from dancediff.motion.motion import Motion
from dancediff.music.features import beat_times
from dancediff.nn.conditioning import cached_music
from dancediff.nn.dance_network import DanceNetwork
from dancediff.training.objective import BatchLosses

BATCHES = 6  # of dances, and as many others to compare with
STEPS = 12
SIGMA_MIN = 0.16
METRICS_FILE = "metrics.csv"  # beside the checkpoint
METRICS = (
    *("FID_k", "FID_g", "Div_k", "Div_g", "GMR", "unison", "TIF", "MMC", "FSR", "PFC"),
    "joint speed",
)


class ValidationMetrics:
    """Scores of a network's own dances, a row each time, in ``metrics.csv``.

    ``data``: batches of held-out windows, see `dancediff.data.windows.WindowSampler`.
    """

    def __init__(self, data, path: Path | None):
        self.data, self.path = data, path

    def row(self, model: DanceNetwork, objective: BatchLosses, step: int) -> dict[str, float]:
        """Dance the same windows as each time, with the same noise, and write what they score."""
        dances = []
        for number in range(BATCHES):
            batch = self.data.batch(number)
            x = dance_windows(model, objective.to_network(batch), number)
            dances += measured(batch._replace(x=x))
        rows = {row.name: row.value for row in table_rows(dances, self.reference)}
        scores = {name: rows[name] for name in METRICS}
        if self.path is not None:
            append_row(self.path, {"step": step, **scores})
        return scores

    @cached_property
    def reference(self) -> list[Measured]:
        """Other held-out windows as people or the choreographer danced them."""
        batches = (self.data.batch(number) for number in range(BATCHES, 2 * BATCHES))
        return [one for batch in batches for one in measured(batch)]


def dance_windows(
    model: DanceNetwork, batch: Batch, seed: int, options: SamplerOptions | None = None
) -> Tensor:
    """Dances of a bare network to the music of a batch, whose order and genre they have.

    ``options``: default twelve steps of DPM-Solver++ that end where noise is left.

    Shapes: `Batch` in the network's units -> x (b, n, f, d).
    """
    conditions = Conditions(batch.M, swap=batch.label, genre=batch.genre, energy=batch.energy)
    if options is None:
        options = SamplerOptions(model.abar, "dpm", STEPS, 0.0, clamp=None, sigma_min=SIGMA_MIN)
    generator = torch.Generator().manual_seed(seed)
    conditions = model.with_draws(conditions, generator)
    with torch.inference_mode(), cached_music(model):
        run = guided(cast(Denoiser, model).denoise, conditions, 1.0)
        x = sample(run, batch.x.shape, options, generator=generator)
    return model.normalizer.unnormalize(x.clone().float()).cpu()


def measured(batch: Batch) -> list[Measured]:
    """What metrics need of every window; its beats are those of its music."""
    return [
        measure(Motion.from_features(x), beats=beat_times(M))
        for x, M in zip(batch.x, batch.M, strict=True)
    ]


def append_row(path: Path, row: dict) -> None:
    """Add a row to a CSV; rows of the same step or a later one are replaced.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "metrics.csv"
    >>> for step in (1, 2, 1):
    ...     append_row(path, {"step": step, "GMR": 0.5})
    >>> path.read_text().split()
    ['step,GMR', '1,0.5']
    """
    rows = list(csv.DictReader(path.read_text("utf-8").splitlines())) if path.exists() else []
    kept = [old for old in rows if int(old["step"]) < row["step"]]
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(row), restval="", extrasaction="ignore")
        table.writeheader()
        table.writerows([*kept, {k: f"{v:.6g}" for k, v in row.items()}])
