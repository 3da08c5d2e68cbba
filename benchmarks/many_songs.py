"""How many songs a second `dancediff generate` dances to, by number of workers.

    python benchmarks/many_songs.py --songs 40 --seconds 20 --workers 1 2

Every number of workers makes the same dances from the beginning, in processes of its own, loading
of libraries and models included; their bytes are compared. One line each, the last one as JSON.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import tyro
from result_table import write_table

from dancediff.music.synth import synth_song


@dataclass
class Args:
    """What to measure."""

    songs: int = 40
    seconds: float = 20.0
    workers: tuple[int, ...] = (1, 2)
    backend: str = "loky"
    json_file: Path | None = None


def content(folder: Path) -> dict[str, bytes]:
    """The bytes of every file."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def danced(songs: Path, out: Path, workers: int, backend: str) -> float:
    """Seconds that the command takes."""
    words = ["generate", str(songs), "--out", str(out), "--formats", "npz", "--json"]
    how = ["--workers", str(workers), "--backend", backend]
    begun = time.monotonic()
    subprocess.run(
        [sys.executable, "-m", "dancediff.cli", *words, *how],
        check=True,
        stdout=subprocess.DEVNULL,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    return time.monotonic() - begun


def main(args: Args) -> None:
    """Make the songs, dance to them with each number of workers, compare."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "songs").mkdir()
        for seed in range(args.songs):
            song = synth_song(seed, seconds=args.seconds)[0]
            song.save(folder / "songs" / f"{seed:03}.wav")
        speed, first = {}, None
        for workers in args.workers:
            out = folder / str(workers)
            speed[workers] = args.songs / danced(folder / "songs", out, workers, args.backend)
            made = content(out)
            assert first in (None, made), f"{workers} workers made other bytes"
            first = made
            times = speed[workers] / speed[args.workers[0]]
            print(f"{workers} workers: {speed[workers]:.3f} songs/s, {times:.2f} x the first")
        print(json.dumps({"songs_per_second": speed, "cores": os.cpu_count()}))
    if args.json_file is not None:
        write_table(args.json_file, table(args, speed))


def table(args: Args, speed: dict[int, float]) -> dict:
    """In the form of docs/results/*.json."""
    first = speed[args.workers[0]]
    counts = " ".join(map(str, args.workers))
    return {
        "about": "Songs a second of `dancediff generate FOLDER`, loading included, "
        f"{args.songs} songs of {args.seconds:g} s; the bytes of all dances are the same.",
        "data": "synthetic songs",
        "date": datetime.now(UTC).date().isoformat(),
        "command": f"python benchmarks/many_songs.py --songs {args.songs} --seconds "
        f"{args.seconds:g} --workers {counts}",
        "columns": ["workers", "songs a second", "times the first"],
        "rows": [[n, round(one, 3), round(one / first, 2)] for n, one in speed.items()],
    }


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
