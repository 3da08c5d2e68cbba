"""Does a long dance stay what it was? The tables of docs/results_tcdiffpp.md, "A minute".

    dancediff prepare choreograph 250 held --seconds 30 --seed 500000
    dancediff prepare cmu CMU_FOLDER cmu
    python benchmarks/drift_bars.py truth held cmu
    python benchmarks/drift_bars.py dances held SONG SONG ... --out runs/drift
    python benchmarks/drift_bars.py dances held SONG SONG ... --pinning renoise --out runs/renoise

``truth`` prints the posture of choreographed (synthetic) and captured (real) dances, by genre.
``dances`` dances to every song with every seed and group size, and holds the bars against the
held-out dances. Every song has noise of its own: noise decides more of a dance than the song does.
What was danced is kept in --out and not danced again.
"""

import json
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import joblib
import numpy as np
import tyro
from kept_dances import digest_of, only_one_way
from tqdm.auto import tqdm

from dancediff.atomic import write_text
from dancediff.bench.in_processes import in_processes
from dancediff.bench.scores import loaded
from dancediff.data.prepared import PreparedData
from dancediff.metrics.drift import Drift, drift, mean_drift
from dancediff.metrics.posture import POSTURE
from dancediff.motion.motion import Motion
from dancediff.music.song import Music

FRAMES = 150
NAMES = tuple(POSTURE)


def takes(folder: str):
    """Genre, kind and drift of every take that is no composition of others."""
    data = PreparedData(folder)
    for entry in tqdm(list(data), desc=Path(folder).name):
        take = data.load(entry)
        if entry.kind != "composed" and take.motion.num_frames >= FRAMES:
            yield str(take.genre), entry.kind, drift(take.motion.joints())


def cells(values: np.ndarray) -> str:
    """Mean, and the range of nine tenths of the windows, of each metric (metric, window)."""
    low, high = np.quantile(values, [0.05, 0.95], axis=1)
    parts = zip(values.mean(1), low, high, strict=True)
    return " | ".join(f"{m:.3g} ({a:.2g} - {b:.2g})" for m, a, b in parts)


@dataclass
class Truth:
    """Posture of dances that nobody sampled, by genre; in brackets 5 and 95 % of windows."""

    folders: tyro.conf.Positional[tuple[str, ...]]

    def run(self) -> None:
        """Print the table."""
        rows = defaultdict(list)
        for folder in self.folders:
            for genre, kind, found in takes(folder):
                for name in (f"{genre} ({kind})", f"all {kind}"):
                    rows[name].append(found.values)
        print(f"| windows of 5 s | n | {' | '.join(NAMES)} |\n|{' --- |' * (2 + len(NAMES))}")
        for name in sorted(rows):
            values = np.concatenate(rows[name], axis=1)
            print(f"| {name} | {values.shape[1]} | {cells(values)} |")


@dataclass
class Dances:
    """Dance to songs, and hold the bars."""

    held: tyro.conf.Positional[str]
    songs: tyro.conf.Positional[tuple[str, ...]]
    model: str = "tcdiffpp"
    seconds: float = 60.0
    dancers: tuple[int, ...] = (1, 3, 5)
    seeds: tuple[int, ...] = (1, 2)
    autoguidance: float | None = None
    foot_contact: bool | None = None
    overlap: int | None = None
    pinning: str | None = None
    workers: int = 2
    out: Path = field(default_factory=lambda: Path("runs/drift"))

    def run(self) -> None:
        """Print posture by window, then each bar with what was measured."""
        names = ("autoguidance", "foot_contact", "overlap", "pinning")
        options = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        how = {"model": digest_of(self.model), "seconds": self.seconds, "songs": self.songs}
        only_one_way(self.out, options | how)
        jobs = {
            (n, seed, song): self.out / f"{Path(song).stem}-{n}-{seed}.npz"
            for song in self.songs
            for n in self.dancers
            for seed in self.seeds
        }
        todo = [
            joblib.delayed(dance_song)(self.model, song, path, self.seconds, n, noise, options)
            for (n, seed, song), path in jobs.items()
            for noise in [1000 * seed + self.songs.index(song)]
            if not path.exists()
        ]
        in_processes(todo, self.workers)
        found = {key: drift(Motion.load(path).joints()) for key, path in jobs.items()}
        truth = [one for _, kind, one in takes(self.held) if kind == "synthetic"]
        self.report(found, truth)

    def report(self, found: dict, truth: list[Drift]) -> None:
        """Both tables; the JSON lies beside the dances."""
        print(f"{len(found)} dances of {self.seconds:g} s, mean by window:")
        print(mean_drift(list(found.values())), end="\n\n")
        groups = {f"{n} dancers": [d for k, d in found.items() if k[0] == n] for n in self.dancers}
        groups["all"] = list(found.values())
        results = {name: bars(part, truth) for name, part in groups.items()}
        print(f"| bar | {' | '.join(groups)} |\n|{' --- |' * (1 + len(groups))}")
        facts = {}
        for bar in results["all"]:
            row = [results[name][bar] for name in groups]
            words = [f"{text}, {'yes' if ok else 'NO'}" for text, ok in row]
            print(f"| {bar} | {' | '.join(words)} |")
            facts[bar] = dict(zip(groups, words, strict=True))
        facts["windows"] = {"-".join(map(str, key)): d.facts() for key, d in found.items()}
        write_text(self.out / "drift.json", json.dumps(facts) + "\n")


def bars(dances: list[Drift], truth: list[Drift]) -> dict[str, tuple[str, bool]]:
    """Every bar: what was measured over the dances, and whether it holds."""
    first, last = ({k: np.mean([d.thirds(k)[e] for d in dances]) for k in NAMES} for e in (0, 1))
    held = {k: np.concatenate([d[k] for d in truth]) for k in NAMES}
    low, high = np.quantile(held["knee bend"], [0.05, 0.95])
    begin = np.mean([d["distinct poses"][0] for d in dances])
    wide, knees, close = last["arms wide"], last["knee bend"], last["ankles close"]
    ratio, usual = knees / first["knee bend"], held["turning"].mean()
    poses = last["distinct poses"] / begin
    most = 1.5 * first["arms wide"] + 0.1
    allowed = 1.5 * held["ankles close"].mean()
    return {
        "arms wide, last third: at most 0.3": (f"{wide:.2f}", wide <= 0.3),
        "and at most 1.5 x first third + 0.1": (f"{wide:.2f} for {most:.2f}", wide <= most),
        "knee bend, last third: at least 0.75 x first": (f"{ratio:.2f}", ratio >= 0.75),
        f"and within {low:.0f} ... {high:.0f} degrees": (f"{knees:.0f}", low <= knees <= high),
        f"ankles close, last third: at most {allowed:.3f}": (f"{close:.3f}", close <= allowed),
        f"turning, last third: at least {usual / 2:.1f} degrees/s": (
            f"{last['turning']:.1f}",
            last["turning"] >= usual / 2,
        ),
        "distinct poses, last third: at least 0.8 x first window": (f"{poses:.2f}", poses >= 0.8),
    }


def dance_song(
    model: str, song: str, path: Path, seconds: float, dancers: int, seed: int, options: dict
) -> None:
    """Dance to a song, as long as it is at the most, and write the dance."""
    music = Music.load(song)
    loaded(model).generate(
        music, dancers=dancers, seconds=min(seconds, music.duration), seed=seed, **options
    ).save(path)


if __name__ == "__main__":
    parts = {"truth": Truth, "dances": Dances}
    tyro.extras.subcommand_cli_from_dict(parts).run()
