"""Is each genre, asked for, danced as it is for a whole minute? Posture beside held-out dances.

    dancediff prepare choreograph 250 held --seconds 30 --seed 500000
    python benchmarks/posture_by_genre.py held SONG SONG ... --out runs/posture

Three dancers are asked for each genre, to those songs in turn that are long enough. Every metric of
posture, in every window of 5 s, is held against nine tenths of the windows of the choreographer's
dances of that genre (synthetic); of windows that he danced himself, nine tenths are inside. What
was danced is kept in --out and not danced again. Writes docs/results/tcdiffpp_posture.json.

Symbols (axes: g genres · d dances · m metrics · w windows)
    values   every metric of every dance in every window      (g, d, m, w)
    limits   5 and 95 % of held-out windows, by genre         (g, m, 2)
"""

import sys
from collections import defaultdict
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import joblib
import numpy as np
import soundfile
import tyro
from drift_bars import dance_song, takes
from kept_dances import digest_of, only_one_way
from result_table import write_table

from dancediff.bench.in_processes import in_processes
from dancediff.data.choreographer import GENRES
from dancediff.metrics.drift import Drift, drift, ranges
from dancediff.metrics.posture import POSTURE
from dancediff.motion.motion import Motion

sys.path.insert(0, str(Path(__file__).parents[1] / "docs" / "site"))

from tables import markdown

MOST = 1.3  # how many times the first window the last may be, or the first the last


@dataclass
class Row:
    """One metric, over all genres."""

    name: str
    windows: float  # share of single windows within the range of their genre
    means: float  # share of means over the dances of a genre, window by window, within it
    first: float  # window, mean over all dances
    last: float

    @property
    def holds(self) -> bool:
        """Whether all means are in the range of their genre and the last window is as the first."""
        same = self.last <= MOST * self.first and self.first <= MOST * self.last
        return self.means == 1 and same

    def cells(self) -> list:
        """For the table."""
        numbers = (self.windows, self.means, self.first, self.last)
        return [
            self.name,
            *(float(f"{x:.3g}") for x in numbers),
            "yes" if self.holds else {"bold": "no"},
        ]


def rows_of(made: dict[str, list[Drift]], held: dict[str, list[Drift]]) -> list[Row]:
    """A row for each metric; dances of as many windows, by genre.

    Raises: ValueError when a genre has no held-out dance.
    """
    lacking = sorted(set(made) - set(held))
    if lacking:
        raise ValueError(f"no held-out dance is {', '.join(lacking)}; prepare more")
    values = np.array([[one.values for one in dances] for dances in made.values()])
    limits = np.array([ranges(held[genre]) for genre in made])  # (g, m, 2)
    low, high = limits[:, None, :, None, 0], limits[:, None, :, None, 1]
    single = (values >= low) & (values <= high)  # (g, d, m, w)
    mean = values.mean(1, keepdims=True)
    inside = (mean >= low) & (mean <= high)  # (g, 1, m, w)
    ends = values.mean((0, 1))  # (m, w)
    return [
        Row(name, single[:, :, k].mean(), inside[:, :, k].mean(), ends[k, 0], ends[k, -1])
        for k, name in enumerate(POSTURE)
    ]


@dataclass
class PostureByGenre:
    """Dance, measure, write the table."""

    held: tyro.conf.Positional[str]
    songs: tyro.conf.Positional[tuple[str, ...]]
    model: str = "tcdiffpp"
    each: int = 4
    """Dances of each genre."""
    seconds: float = 60.0
    dancers: int = 3
    workers: int = 2
    out: Path = Path("runs/posture")
    results: Path = Path("docs/results")

    def run(self) -> None:
        """The table."""
        how = {"model": digest_of(self.model), "seconds": self.seconds, "dancers": self.dancers}
        only_one_way(self.out, how | {"songs": self.songs, "each": self.each})
        held = defaultdict(list)
        for genre, kind, found in takes(self.held):
            if kind == "synthetic":
                held[genre].append(found)
        songs = [song for song in self.songs if soundfile.info(song).duration >= self.seconds]
        jobs = {
            (genre, k): self.out / f"{genre}-{k}.npz" for genre in GENRES for k in range(self.each)
        }
        todo = [
            joblib.delayed(dance_song)(
                *(self.model, songs[seed % len(songs)], path, self.seconds),
                *(self.dancers, seed, {"genre": genre}),
            )
            for seed, ((genre, _), path) in enumerate(jobs.items())
            if not path.exists()
        ]
        in_processes(todo, self.workers)
        made = defaultdict(list)
        for (genre, _), path in jobs.items():
            made[genre].append(drift(Motion.load(path).joints()))
        table = self.table(rows_of(made, held))
        write_table(self.results / "tcdiffpp_posture.json", table)
        print(markdown(table))

    def table(self, rows: list[Row]) -> dict:
        """As the pages have it."""
        return {
            "about": f"{len(GENRES) * self.each} dances of {self.seconds:g} s to recorded songs, "
            f"{self.each} of each genre asked for, {self.dancers} dancers, the preset. Windows of "
            "5 s within 5 to 95 % of held-out windows of their genre (nine tenths of his own are): "
            "single ones, and means over the dances of a genre. Bar: all means, and the first and "
            f"the last window, means over all dances, within {MOST:g} times of each other.",
            "data": "recorded songs; held-out: synthetic",
            "seed": "one a dance",
            "date": date.today().isoformat(),
            "command": "python benchmarks/posture_by_genre.py HELD SONGS",
            "columns": [
                "metric",
                "windows within",
                "means within",
                "first window",
                "last",
                "holds",
            ],
            "rows": [row.cells() for row in rows],
        }


if __name__ == "__main__":
    tyro.cli(PostureByGenre).run()
