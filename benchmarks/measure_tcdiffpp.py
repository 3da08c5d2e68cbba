"""Measure the packaged TCDiff++ again: the tables of its page, of control and of its additions.

    python benchmarks/measure_tcdiffpp.py --shared DATA --training DATA/all --workers 2

``--shared`` holds recorded songs in music/ and motion capture in cmu/; ``--training`` is what the
weights were trained on. Every step is a command that can be typed by hand; what it prints is kept
in ``--out`` and a step that is done is not run again. Then the tables of docs/results that other
programs only print are filled: head and rows stay, numbers and the date change. Words are left to
people: the column of older weights, what looks wrong in a watched dance, and the prose of the
pages, into which `python docs/site/tables.py` puts the tables. Takes hours.
"""

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import tyro
from result_table import write_table
from tqdm.auto import tqdm

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "docs" / "results"
CPU = "EsoXLB-CPU"
MUSIC = (
    *("hr-savino-ocean", CPU, "Impulslogik-Zen"),
    *("TameAnderson-MakeMe", "Thomasso-AxeFromThe80s", "CapDan-ReggaetonTry"),
)
MINUTE = (
    *("CapDan-ReggaeTry", "CapDan-ReggaetonTry", "CapDan-TwilightArea-OriginalByAlf42red", CPU),
    *("Impulslogik-Zen", "Settel-InnerRecreation"),
    *("TameAnderson-MakeMe", "Thomasso-AxeFromThe80s"),
)
WATCHED = (*MINUTE, "hr-savino-ocean", "hr-savino-palace")
CHOREOGRAPH = "dancediff prepare choreograph --workers {workers}"
BARS = "python benchmarks/bars.py"
WINDOWS = f"{BARS} dances tcdiffpp {{held}} {{other}} --workers {{workers}}"
LONG = f"{WINDOWS} --frames 720 --count 60 --kinds synthetic"
HUNDRED = "--count 100 --kinds synthetic --seeds 0"
# the network alone: nothing acts while a dance is sampled
BARE = "--sampling.foot-contact False --sampling.collision-avoidance False"
BARE += " --sampling.order-constraint False --sampling.frequency-clip False"
COMMANDS = {
    "data_cmu": "dancediff prepare cmu {shared}/cmu {held} --workers {workers}",
    "data_held": f"{CHOREOGRAPH} 200 {{held}} --seconds 25 --seed 500000",
    "data_tuning": f"{CHOREOGRAPH} 100 {{tuning}} --seconds 25 --seed 600000",
    "data_other": f"{CHOREOGRAPH} 400 {{other}} --seconds 25 --seed 700000",
    "data_held30": f"{CHOREOGRAPH} 100 {{held30}} --seconds 30.5 --seed 500000",
    "one_song": f"python benchmarks/dance_bars.py {{music}}/{CPU}.ogg --seconds 20 --seed 1",
    "held_out": f"{WINDOWS} --frames 150 --count 500",
    "swaps_3": f"{BARS} swaps tcdiffpp {{other}} --each 20 --workers {{workers}}",
    "swaps_2": f"{BARS} swaps tcdiffpp {{other}} --dancers 2 --each 60 --workers {{workers}}",
    "swaps_4": f"{BARS} swaps tcdiffpp {{other}} --dancers 4 --each 5 --workers {{workers}}",
    "swaps_5": f"{BARS} swaps tcdiffpp {{other}} --dancers 5 --each 1 --workers {{workers}}",
    "swaps_bare": f"{BARS} swaps tcdiffpp {{other}} --each 20 --workers {{workers}} {BARE}",
    "bare": f"{WINDOWS} {HUNDRED} --out runs/bare {BARE}",
    "with_rules": f"{WINDOWS} {HUNDRED} --out runs/with_rules",
    "any_song": "python benchmarks/any_song.py tcdiffpp --data {shared}",
    "music": f"{BARS} music tcdiffpp {{six}} --seeds 0 --workers {{workers}}",
    "tuning": f"{BARS} dances tcdiffpp {{tuning}} {{other}} --count 100 --kinds synthetic"
    " --seeds 0 --out runs/tuning --workers {workers}",
    "minute": "python benchmarks/drift_bars.py dances {held30} {eight} --workers {workers}",
    "posture": "python benchmarks/posture_by_genre.py {held30} {ten} --workers {workers}",
    "formations": "python benchmarks/formation_bars.py runs/drift {held30}",
    "watched": "python benchmarks/watched.py {ten}",
    "long": LONG,
    "naive": f"{LONG} --naive",
    "control": "python benchmarks/control_bars.py --seeds 4 --steps 8",
    "rules": "python benchmarks/rule_shares.py tcdiffpp",
    "few_steps": "python benchmarks/few_steps.py tcdiffpp {training} --batches 5 --samplers"
    " 'dpm 4 0.16' 'dpm 6 0.16' 'dpm 6 0.07' 'dpm 8 0.07' 'dpm 12 0.07' 'ddim 50'",
    "extensions": "python benchmarks/extensions.py tcdiffpp",
    "extensions_genres": "python benchmarks/extensions.py tcdiffpp_genres",
    "extensions_swaps": "python benchmarks/extensions.py tcdiffpp_swaps",
    "extensions_long": "python benchmarks/extensions.py tcdiffpp_long",
    "extensions_strange": "python benchmarks/extensions.py tcdiffpp_strange",
    "memory": f"{BARS} memory runs/bars/tcdiffpp-150 {{training}} {{held}}",
}


def cells_in(text: str) -> list[list[str]]:
    r"""Rows of all tables of a text, heads too; columns lie between bars.

    >>> cells_in('a line\n| song | 1 |\n| --- | --- |\n| x | 2.5 |')
    [['song', '1'], ['x', '2.5']]
    """
    rows = [line.strip().strip("|").split("|") for line in text.splitlines() if line[:1] == "|"]
    stripped = ([cell.strip() for cell in row] for row in rows)
    return [row for row in stripped if not set("".join(row)) <= set("-")]


def number(text: str):
    """A printed cell as a table has it: a number, one with its interval, None, or words.

    >>> number("0.12345"), number("2.1234 [1.9, 2.3001]"), number("8"), number("0.17, yes")
    (0.123, [2.12, 1.9, 2.3], 8, '0.17, yes')
    """
    if text.isdigit():
        return int(text)
    found = re.fullmatch(r"(\S+)(?: \[(\S+), (\S+)\])?", text)
    try:
        values = [float(f"{float(part):.3g}") for part in found.groups() if part]
    except (AttributeError, ValueError):
        return text or None
    return values if len(values) == 3 else values[0]


def by_metric(table: dict, printed: str, columns: dict[str, int]) -> list[list]:
    r"""Rows of a table with the columns of a print, which has more metrics.

    Raises: KeyError when the print lacks a metric of the table.

    >>> table = {"columns": ["metric", "old", "new"], "rows": [["GMR", 1.0, 2.0]]}
    >>> by_metric(table, "| FID_k | 5 |\n| GMR | 4 |", {"new": 1})
    [['GMR', 1.0, 4]]
    >>> table = {"columns": ["metric", "new"], "rows": [["joint speed, m/s", 1.0]]}
    >>> by_metric(table, "| joint speed | 0.4 |", {"new": 1})
    [['joint speed, m/s', 0.4]]
    """
    found = {row[0]: row for row in cells_in(printed)}
    rows = []
    for row in table["rows"]:
        printed_as = re.sub(r", .*| a (dance|second)$", "", row[0])  # a table has units, too
        cells = {name: number(found[printed_as][k]) for name, k in columns.items()}
        rows.append([cells.get(n, old) for n, old in zip(table["columns"], row, strict=True)])
    return rows


def whole(table: dict, printed: str) -> list[list]:
    """All rows as they were printed, numbers as numbers; the first cell is a name."""
    return [[row[0], *map(number, row[1:])] for row in cells_in(printed)[1:]]


def with_worst(printed: str) -> list[list]:
    r"""Rows of control_bars.py: "mean, at worst" becomes two numbers.

    >>> with_worst("| control | error cm |\n| start | 0.50, at worst 1.25 |")
    [['start', 0.5, 1.25]]
    """
    rows = []
    for name, *cells in cells_in(printed)[1:]:
        rows.append([name, *(float(part) for cell in cells for part in cell.split(", at worst "))])
    return rows


def by_window(table: dict, printed: str) -> list[list]:
    r"""Rows of posture, as drift_bars.py prints them: those metrics that the table has.

    >>> printed = "2 dances:\nseconds  turning  arms wide\n    0-5     3.25        0.1\n\n| bar |"
    >>> by_window({"columns": ["seconds", "arms wide"]}, printed)
    [['0-5', 0.1]]
    """
    lines = [re.split(r"\s{2,}", line.strip()) for line in printed.splitlines()]
    head = next(line for line in lines if line[0] == "seconds")
    wanted = [head.index(name) for name in table["columns"][1:]]
    rows = (line for line in lines if re.fullmatch(r"\d+-\d+", line[0]))
    return [[row[0], *(float(row[k]) for k in wanted)] for row in rows]


def by_song(table: dict, printed: str) -> list[list]:
    """Rows of ``bars.py music``, under the songs' short names; the last is their mean."""
    rows = cells_in(printed)
    values = [[number(cell) for cell in row[1:5]] for row in rows]
    if len(values) != len(table["rows"]):
        raise ValueError(f"{len(values)} songs were printed; the table has {len(table['rows'])}")
    rounded = [[bpm, *(round(x, 2) for x in rest)] for bpm, *rest in values]
    return [[old[0], *new] for old, new in zip(table["rows"], rounded, strict=True)]


FILLED: tuple[tuple[str, str, Callable[[dict, str], list[list]]], ...] = (  # table, step, rows
    ("tcdiffpp_dances", "one_song", whole),
    (
        "tcdiffpp_held_out",
        "held_out",
        lambda t, text: by_metric(t, text, {"dances": 1, "held-out": 2}),
    ),
    ("tcdiffpp_before", "tuning", lambda t, text: by_metric(t, text, {"now": 1, "held-out": 2})),
    ("tcdiffpp_long", "long", lambda t, text: by_metric(t, text, {"LGDS": 1, "held-out": 2})),
    ("tcdiffpp_long", "naive", lambda t, text: by_metric(t, text, {"naive": 1})),
    ("tcdiffpp_bare", "bare", lambda t, text: by_metric(t, text, {"bare": 1, "held-out": 2})),
    ("tcdiffpp_bare", "with_rules", lambda t, text: by_metric(t, text, {"preset": 1})),
    ("tcdiffpp_swaps", "swaps_3", lambda t, text: by_metric(t, text, {"kept": 1, "asked": 2})),
    ("tcdiffpp_swaps", "swaps_bare", lambda t, text: by_metric(t, text, {"bare": 1})),
    ("tcdiffpp_music", "music", by_song),
    ("tcdiffpp_minute", "minute", by_window),
    ("tcdiffpp_minute_bars", "minute", lambda table, text: cells_in(text)[1:]),
    ("few_steps", "few_steps", whole),
    ("control", "control", lambda table, text: with_worst(text)),
)


@dataclass
class Measure:
    """Run what has not run yet, then fill the tables."""

    shared: Path
    training: Path
    folders: Path = Path("data")
    """Where held, tuning, other and held30 are made."""
    out: Path = Path("runs/measured")
    only: tuple[str, ...] = ()
    workers: int = 2

    def run(self) -> None:
        """All steps in order; one that fails stops the program, with what it printed at the end."""
        self.out.mkdir(parents=True, exist_ok=True)
        for name in tqdm(self.only or COMMANDS, desc="measuring"):
            if not (self.out / f"{name}.txt").exists():
                self.step(name)
        for table, step, rows_of in FILLED:
            self.fill(table, step, rows_of)

    def words(self, name: str) -> list[str]:
        """The command of a step, ready to run with this Python."""
        shared, training = self.shared.resolve(), self.training.resolve()
        music, folders = shared / "music", self.folders.resolve()
        places = {n: folders / n for n in ("held", "tuning", "other", "held30")}
        songs = {"six": MUSIC, "eight": MINUTE, "ten": WATCHED}
        known = {"shared": shared, "training": training, "music": music, **places}
        known = {name: shlex.quote(str(path)) for name, path in known.items()}
        lists = {n: shlex.join(f"{music}/{s}.ogg" for s in some) for n, some in songs.items()}
        typed = COMMANDS[name].format(**known, **lists, workers=self.workers)
        first, *rest = shlex.split(typed)
        program = ["-m", "dancediff.cli.__main__"] if first == "dancediff" else []
        return [sys.executable, *program, *rest]

    def step(self, name: str) -> None:
        """One command; what it prints is there only when it is whole."""
        part = self.out / f"{name}.part"
        with part.open("w", encoding="utf-8") as file:
            subprocess.run(self.words(name), cwd=ROOT, stdout=file, check=True)
        part.rename(part.with_suffix(".txt"))

    def fill(self, name: str, step: str, rows_of: Callable[[dict, str], list[list]]) -> None:
        """One table, if its step has run."""
        printed, path = self.out / f"{step}.txt", RESULTS / f"{name}.json"
        if not printed.exists():
            return
        table = json.loads(path.read_text(encoding="utf-8"))
        table["rows"] = rows_of(table, printed.read_text(encoding="utf-8"))
        table["date"] = date.fromtimestamp(printed.stat().st_mtime).isoformat()
        write_table(path, table)


if __name__ == "__main__":
    tyro.cli(Measure).run()
