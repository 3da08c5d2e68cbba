"""Measure live dancing: what the page of `dancediff live` promises.

    python benchmarks/live_bars.py                           # a minute, the packaged song twice
    python benchmarks/live_bars.py --seconds 300             # stalls and lead over five minutes
    python benchmarks/live_bars.py --seconds 7200 --speed 6 --dancers 1   # memory over two hours

It plays as the page does, in real time unless --speed is given, without drawing. Times need an idle
computer; beside each first movement stands how much the processor worked for it, which a busy one
changes less.
"""

import json
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import torch
import tyro
from result_table import write_table
from tqdm.auto import tqdm

import dancediff as dd
from dancediff.generation.stream import Stream
from dancediff.live_dance.session import OPENING, LiveSession
from dancediff.music.song import Music

FIRST = 300.0  # seconds of the song, at most, whose first movement is measured
REPEATS = 5  # of a first movement; the middle one is shown
GROUPS = (1, 3)  # dancers whose first movement is measured
TICK = 0.05  # seconds between two looks at the dance, as a page has them
ENOUGH = 1.0  # seconds that a dance that had to wait needs to go on, as in live.js
AT_ANY_SPEED = ("memory, end to first fifth", "replay is equal", "seams as in generate")
BARS: dict[str, tuple[str, Callable[[float], bool]]] = {
    "first movement, 1 dancer": ("1.2 s", lambda seconds: seconds <= 1.2),
    "first movement, 3 dancers": ("2 s", lambda seconds: seconds <= 2),
    "p5 of ahead [s]": ("1 s", lambda seconds: seconds >= 1),
    "stalls": ("none", lambda stalls: stalls == 0),
    "memory, end to first fifth": ("1.05", lambda ratio: ratio <= 1.05),
    "replay is equal": ("yes", bool),
    "seams as in generate": ("yes", bool),
}


@dataclass
class LiveBars:
    """Print and store first movement, lead, stalls, memory, seams and replay."""

    seconds: float = 60.0
    dancers: int = 3
    song: Path | None = None
    model: str = "tcdiffpp"
    seed: int = 0
    speed: float = 1.0  # of the player: above 1 memory over hours is seen in minutes
    machine: str = "two cores of a virtual CPU, idle"
    json_file: Path | None = None

    def run(self) -> None:
        """All bars, one after the other."""
        model = dd.load(self.model)
        song = dd.packaged_song() if self.song is None else Music.load(self.song)
        song = as_long_as(song, self.seconds)
        facts = {"dancers": self.dancers, "song seconds": round(song.duration, 1)}
        facts |= {"threads": torch.get_num_threads(), "speed of the player": self.speed}
        short = song.slice(0, FIRST)
        facts["first movement in a new process"] = first_movement(model, short, self.dancers)
        for n in GROUPS:
            times = sorted(first_movement(model, fresh(short), n) for _ in range(REPEATS))
            facts[f"first movement, {n} dancer{'s' * (n > 1)}"] = times[REPEATS // 2]
        facts |= self.play(model, fresh(song))
        facts["seams as in generate"] = same_as_generate(model, short)
        for name, value in facts.items():
            values = value if isinstance(value, tuple) else (value,)
            words = [f"{one:.3g}" if isinstance(one, float) else str(one) for one in values]
            print(f"{name}: {' s, of work '.join(words)}" + " s" * isinstance(value, tuple))
        if self.json_file is not None:
            write_table(self.json_file, self.table(facts))

    def table(self, facts: dict) -> dict:
        """In the form of docs/results/*.json, beside what was promised."""
        rows = []
        for name, value in facts.items():
            seconds = value[0] if isinstance(value, tuple) else value
            bar, holds = BARS.get(name, (None, lambda _: None))
            shown = round(seconds, 2) if isinstance(seconds, float) else seconds
            if isinstance(shown, bool):
                shown = "yes" if shown else "**no**"
            held = holds(seconds) if self.speed == 1 or name in AT_ANY_SPEED else None
            rows.append([name, shown, bar, {True: "yes", False: "**no**", None: None}[held]])
        more = f" --speed {self.speed:g} --dancers {self.dancers}" if self.speed != 1 else ""
        return {
            "about": f"Live dancing on {self.machine}; first movements are the "
            f"middle of {REPEATS}.",
            "data": "synthetic: the packaged song, again and again"
            if self.song is None
            else f"real: {self.song.name}",
            "date": datetime.now(UTC).date().isoformat(),
            "command": f"python benchmarks/live_bars.py --seconds {self.seconds:g}{more}",
            "columns": ["what", "measured", "bar", "holds"],
            "rows": rows,
        }

    def play(self, model, song: Music) -> dict:
        """A session beside a player in real time, then its log once more."""
        session = LiveSession(model, song, dancers=self.dancers, seed=self.seed).start()
        ahead, memory, stalls = played(session, self.seconds, self.speed)
        session.stop()
        session.join()
        dance, _ = session.dance()
        again = Stream.replay(model, song, json.loads(json.dumps(session.stream.log)))
        n = session.stream.request.dancers  # who danced all the time
        pose = torch.cat([piece.pose[:n] for piece in again], dim=1)
        return {
            "p5 of ahead [s]": float(np.percentile(ahead, 5)),
            "p95 of ahead [s]": float(np.percentile(ahead, 95)),
            "stalls": stalls,
            "steps at the end": session.stream.request.steps,
            "dancers at the end": n,
            "seconds a piece, mean": session.stream.timing.mean,
            "seconds a piece, longest": session.stream.timing.longest,
            "memory after a fifth [MB]": memory[len(memory) // 5],
            "memory at the end [MB]": memory[-1],
            "memory, end to first fifth": memory[-1] / memory[len(memory) // 5],
            "replay is equal": bool(torch.equal(pose, dance.pose[:n])),
        }


def as_long_as(song: Music, seconds: float) -> Music:
    """The song, again and again."""
    times = int(np.ceil(seconds / song.duration))
    audio = np.concatenate([song.audio[:]] * times)[: round(seconds * song.rate)]
    return Music(audio, song.rate, song.name)


def fresh(song: Music) -> Music:
    """The same song, of which nothing was heard yet."""
    return Music(song.audio, song.rate, song.name)


def first_movement(model, song: Music, dancers: int) -> tuple[float, float]:
    """Seconds from the call to the first piece, and of the processor's work."""
    begun, worked = time.perf_counter(), time.process_time()
    stream = model.stream(song, opening=OPENING, dancers=dancers)
    next(stream)
    took = time.perf_counter() - begun, time.process_time() - worked
    stream.stop()
    return took


def played(
    session: LiveSession, seconds: float, speed: float = 1.0
) -> tuple[list[float], list[float], int]:
    """Seconds ahead and memory at every look, and how often the player had to wait."""
    at, waiting, stalls, ahead, memory = 0.0, True, 0, [], []
    last = time.perf_counter()
    bar = tqdm(total=round(seconds), desc="seconds of the song")
    while at < seconds - 0.1 and session.is_running:
        time.sleep(TICK)
        bar.update(int(at) - bar.n)
        now = time.perf_counter()
        if not waiting:
            at += speed * (now - last)
        last = now
        at = min(at, session.ready_until(round(at * 30)) / 30)
        session.played(at, stalls)
        left = session.ahead
        rest = seconds - at
        if waiting and left >= min(ENOUGH, rest):
            waiting = False
        elif not waiting and left < 2 / 30 and rest > 0.2:
            waiting, stalls = True, stalls + 1
        if not waiting and left < rest - 0.1:  # what lies behind the end cannot be ready
            ahead.append(left)
        memory.append(resident())
    bar.close()
    return ahead, memory, stalls


def resident() -> float:
    """Memory of this process in MB; its peak where the system does not tell more."""
    status = Path("/proc/self/statm")
    if status.exists():
        return int(status.read_text().split()[1]) * resource.getpagesize() / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def same_as_generate(model, song: Music) -> bool:
    """Without an opening a stream is the dance of `generate`, seams included."""
    options = {"dancers": 2, "seconds": 12.0, "seed": 1}
    whole = model.generate(song, **options)
    pieces = list(model.stream(song, **options))
    equal = torch.equal(torch.cat([piece.pose for piece in pieces], 1), whole.pose)
    return equal and pieces[-1].meta["whole"] == whole.meta


if __name__ == "__main__":
    tyro.cli(LiveBars).run()
