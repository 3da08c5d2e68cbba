"""Are Lodge's dances of five minutes as varied as the choreographer's, and do they come back?

    python benchmarks/lodge_minutes.py lodge --cmu DATA/cmu

Synthetic songs that no training saw, danced by one; the choreographer dances to the same songs.
Salsa is compared with his, captured salsa with the takes that it was learned from.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import joblib
import torch
import tyro
from intervals import Interval, mean_with_interval
from result_table import write_table
from torch import Tensor

from dancediff import hub
from dancediff.axes import ON_FLOOR
from dancediff.bench.in_processes import in_processes
from dancediff.data.choreographer import GENRES, choreograph
from dancediff.data.cmu import cmu_jobs
from dancediff.metrics.fidelity import diversity
from dancediff.metrics.geometric import geometric_features
from dancediff.metrics.kinetic import kinetic_features
from dancediff.metrics.posture import facing
from dancediff.music.varied import synth_varied_song

sys.path.insert(0, str(Path(__file__).parents[1] / "docs" / "site"))

from tables import RESULTS, markdown

FIRST_SONG = 970_000  # no training saw it
WINDOW, LOCAL = 150, 256  # frames that are described as one, of a local segment
BACK = 0.3  # metres from where the dance began that count as the same spot
FRONT = math.pi / 3  # radians off the audience that count as facing it


@dataclass
class Args:
    """What to measure."""

    model: tyro.conf.Positional[str] = "lodge"
    cmu: str = "data/cmu"
    """The captured salsa."""
    songs: int = 6
    seconds: float = 300.0
    salsas: int = 10
    """Songs of half a minute that are danced as salsa, his and the captured one."""
    workers: int = 1


def described(joints: Tensor) -> dict[str, Tensor]:
    """Features of each window of a solo (1, F, j, 3): (w, d) by the name of the metric."""
    count = joints.shape[1] // WINDOW
    windows = joints[0, : count * WINDOW].unflatten(0, (count, WINDOW))
    return {"Div_k": kinetic_features(windows), "Div_g": geometric_features(windows)}


def comes_back(joints: Tensor) -> float:
    """Share of the borders of local segments at which a solo is where it began."""
    root = joints[0, LOCAL - 1 :: LOCAL, 0][:, ON_FLOOR]
    return (root - joints[0, 0, 0, ON_FLOOR]).norm(dim=-1).lt(BACK).double().mean().item()


def faces_front(joints: Tensor) -> float:
    """Share of frames in which dancers face the audience."""
    return facing(joints).abs().lt(FRONT).double().mean().item()


def minutes(model: str, k: int, seconds: float) -> list[Tensor]:
    """Joints of the model's and of the choreographer's dance to the k-th song."""
    song, truth = synth_varied_song(FIRST_SONG + k, seconds=seconds)
    genre = tuple(GENRES)[k % len(GENRES)]
    options = {"seed": k, "seconds": seconds, "genre": genre}
    made = hub.load(model).generate(song, **options)
    his, _ = choreograph(truth.beats, dancers=1, sections=truth.sections, **options)
    return [made.joints(), his.joints()]


def salsa(model: str, k: int) -> list[float | None]:
    """How often salsa to the k-th song behind the others faces the audience.

    The model's "salsa", the choreographer's, and the model's "captured_salsa", if it knows that.
    """
    song, truth = synth_varied_song(FIRST_SONG + 100 + k, seconds=34)
    network = hub.load(model)
    made = network.generate(song, genre="salsa", seed=k)
    his, _ = choreograph(
        truth.beats, dancers=1, sections=truth.sections, seed=k, seconds=34.0, genre="salsa"
    )
    shares: list[float | None] = [faces_front(one.joints()) for one in (made, his)]
    if "captured_salsa" not in network.model.config.genres:
        return [*shares, None]
    captured = network.generate(song, genre="captured_salsa", seed=k)
    return [*shares, faces_front(captured.joints())]


def row(name: str, dances: list[Tensor], reference: dict[str, Tensor]) -> list:
    """Mean and interval over dances of every column."""
    scores: dict[str, list[float]] = {"Div_k": [], "Div_g": [], "back": []}
    for joints in dances:
        for metric, features in described(joints).items():
            scores[metric].append(diversity(features, reference[metric]))
        scores["back"].append(comes_back(joints))
    return [name, *map(cell, scores.values())]


def cell(values: Sequence[float | None]) -> Interval | None:
    """Mean and interval; nothing of a genre that the model does not know."""
    known = [value for value in values if value is not None]
    return mean_with_interval(known, ".3g") if known else None


def main(args: Args) -> None:
    """Dance, measure, and write the table."""
    jobs = [joblib.delayed(minutes)(args.model, k, args.seconds) for k in range(args.songs)]
    pairs = in_processes(jobs, args.workers, label="five minutes")
    made, his = map(list, zip(*pairs, strict=True))
    all_his = [described(joints) for joints in his]
    reference = {name: torch.cat([one[name] for one in all_his]) for name in ("Div_k", "Div_g")}
    jobs = [joblib.delayed(salsa)(args.model, k) for k in range(args.salsas)]
    front, his_front, captured = zip(*in_processes(jobs, args.workers, label="salsa"), strict=True)
    takes = [job.make().motion.joints() for job in cmu_jobs(args.cmu) if "salsa" in job.name]
    true = [faces_front(joints) for joints in takes]
    rows = [row(args.model, made, reference), row("choreographer", his, reference)]
    rows[0] += [cell(front), cell(captured)]
    rows[1] += [cell(his_front), cell(true)]
    table = {
        "about": f"{args.songs} dances of {args.seconds:g} s, one a song: Div over windows of 5 s "
        "of one dance; borders of local segments (8.5 s) at which the dancer stands within 30 cm "
        f"of the start. Faces the audience within 60 degrees, share of frames: {args.salsas} "
        "dances of 34 s of either salsa; captured salsa in the second row is that of the takes.",
        "data": "synthetic songs; captured salsa (CMU)",
        "seed": "one a song",
        "intervals": "95 % bootstrap intervals over dances",
        "date": date.today().isoformat(),
        "command": f"python benchmarks/lodge_minutes.py {args.model} --cmu DATA/cmu",
        "columns": [
            "dances",
            "Div_k",
            "Div_g",
            "back at the start",
            "salsa faces the audience",
            "captured salsa does",
        ],
        "rows": rows,
    }
    write_table(RESULTS / "lodge_minutes.json", table)
    print(markdown(table))


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
