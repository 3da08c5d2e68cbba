r"""Does FACT hear the beat? With the true past before it, and with its own frames.

    dancediff bench-models fact_tiny --data data/bench --minutes 20 --seeds 0
    python benchmarks/forced_beats.py data/bench fact runs/bench/fact_tiny-0/20min/model

Each network guesses solos of the validation split from their first two seconds on: a few frames at
a time after the true frames (teacher-forced), or after its own. Beats are counted as in
heard_beats.py.
Writes docs/results/bench_forced.json.

Symbols (axes: f frames · s frames of the history · d features)
    x   a dance that people or the choreographer danced, normalised   (1, f, d)
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import torch
import tyro
from heard_beats import heard
from result_table import write_table
from tqdm.auto import tqdm

import dancediff as dd
from dancediff.autoregression.roll_out import forced_guesses, roll_out
from dancediff.axes import FPS
from dancediff.data.packed import PackedTakes
from dancediff.data.take import DanceTake
from dancediff.motion.beats import motion_beats
from dancediff.motion.motion import Motion
from dancediff.music.features import beat_times
from dancediff.papers.fact.model import FACT

START, FRAMES = 100, 300  # of a take: its beginning is left out
KEPT = (1, 5)  # frames of each guess: the paper's, and half of them
COLUMNS = ["dances", "MMC", "beats shifted", "motion beats a second", "joint speed, m/s"]


@dataclass
class ForcedBeats:
    """Roll out, teacher-forced and not, and count beats."""

    data: tyro.conf.Positional[Path]
    models: tyro.conf.Positional[tuple[str, ...]]
    count: int = 24
    results: Path = Path("docs/results")

    def run(self) -> None:
        """All rows, and the file."""
        takes = PackedTakes(self.data, split="val").takes(num_frames=START + FRAMES)
        songs = {take.group: take for take in takes if take.kind == "synthetic"}  # a dance of each
        takes = list(songs.values())[: self.count]
        found: dict[str, list] = {}
        for name in self.models:
            model = dd.load(name).model
            for take in tqdm(takes, desc=name):
                for kind, guess in dances_of(model, take).items():
                    row = "held-out dances" if kind == "truth" else f"{label(name)}, {kind}"
                    found.setdefault(row, []).append(beats_of(guess, take, model.history_frames))
        rows = [
            [name, *np.mean(scores, axis=0).round(3).tolist()] for name, scores in found.items()
        ]
        about = f"FACT's guesses of {len(takes)} solos: MMC with the song's beats, and with beats "
        about += "between them. Means."
        table = {
            "about": about,
            "data": "synthetic",
            "date": datetime.now(UTC).date().isoformat(),
            "command": "python benchmarks/forced_beats.py data/bench MODELS",
            "columns": COLUMNS,
            "rows": rows,
        }
        write_table(self.results / "bench_forced.json", table)
        for row in rows:
            print(*row)


def label(name: str) -> str:
    """A packaged name as it is; of a folder of the bench the budget.

    >>> label("fact"), label("runs/bench/fact_tiny-0/20min/model")
    ('fact', '20min')
    """
    return name if "/" not in name else Path(name).parent.name


@torch.no_grad()
def dances_of(model: FACT, take: DanceTake) -> dict[str, Motion]:
    """The truth after a history, and what follows that history, by kind."""
    x = model.normalizer.normalize(take.x[:1, START : START + FRAMES])
    M = model.music_normalizer.normalize(take.M[START:])
    s = model.history_frames
    found = {"truth": x[:, s:]}
    for keep in KEPT:
        how = {"keep": keep, "window": model.config.music_frames}
        found[f"true past, {keep} kept"] = forced_guesses(model, x, M, history=s, **how)
        # its first music is that of the history, which lies before frame 0
        pieces = roll_out(model, x[:, :s], M.roll(-s, 0), frames=FRAMES - s, **how)
        found[f"own frames, {keep} kept"] = torch.cat(list(pieces), dim=1)[:, : FRAMES - s]
    return {
        kind: Motion.from_features(model.normalizer.unnormalize(guess))
        for kind, guess in found.items()
    }


def beats_of(dance: Motion, take: DanceTake, history: int) -> list[float]:
    """MMC, the same with shifted beats, motion beats a second, mean joint speed."""
    joints = dance.joints()
    first = (START + history) / FPS
    beats = beat_times(take.M) - first
    beats = beats[(beats >= 0) & (beats < dance.num_frames / FPS)]
    often = len(motion_beats(joints[0])) / (dance.num_frames / FPS)
    speed = joints.diff(dim=1).norm(dim=-1).mean().item() * FPS
    return [*heard(joints, beats), often, speed]


if __name__ == "__main__":
    tyro.cli(ForcedBeats).run()
