"""Time and memory of `dancediff evaluate` on many clips.

    python benchmarks/evaluate_speed.py --clips 200 --workers 2

Makes choreographed clips (synthetic) with their beats and as many others for reference, then runs
the command in processes of its own. Prints the seconds from start to end, and the peak memory: the
sum over the command and its workers, looked at every 50 ms (Linux).
"""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from dancediff.data.choreographer import choreograph
from dancediff.data.take import DanceTake
from dancediff.data.take_file import write_take

BAR_SECONDS, BAR_GIB = 60, 2.0


@dataclass
class Args:
    """What to make and how to measure it."""

    clips: int = 200
    dancers: int = 3
    frames: int = 150
    workers: int = 2
    reference: bool = False
    """Also measure as many clips as a reference set, for FID, Div and GMR."""
    folder: Path | None = None
    """Where clips are kept for the next time; default: a folder that is deleted again."""


def make(folder: Path, args: Args, seed: int) -> Path:
    """A folder of clips with beats; what is in it already stays."""
    (folder / "takes").mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    seconds = args.frames / 30
    for k in range(args.clips):
        beats = np.arange(rng.uniform(0, 0.5), seconds + 4, 60 / rng.uniform(80, 140))
        path = folder / "takes" / f"clip_{seed + k:07d}.npz"
        if not path.exists():
            motion, _ = choreograph(beats, dancers=args.dancers, seed=seed + k, seconds=seconds)
            take = DanceTake(
                name=path.stem,
                dance=motion,
                kind="synthetic",
                music="none",
                source="choreographer",
                licence="none",
                split="val",
                group=path.stem,
                beats=beats[beats < seconds],
            )
            write_take(path, take)
    return folder


def kilobytes(pid: int) -> int:
    """Memory of a process and of all it started; pages they share count for each."""
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="utf-8")
    except OSError:  # it has ended
        return 0
    own = [int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS")]
    return sum(own) + sum(kilobytes(int(child)) for child in children.split())


def run(command: list[str]) -> tuple[float, float, str]:
    """Seconds, peak GiB and what the command printed."""
    start, peak = time.monotonic(), 0
    with tempfile.TemporaryFile("w+", encoding="utf-8") as words:
        with subprocess.Popen(command, stdout=words, env=os.environ) as process:
            while process.poll() is None:
                peak = max(peak, kilobytes(process.pid))
                time.sleep(0.05)
            seconds = time.monotonic() - start
        words.seek(0)
        if process.returncode:
            raise SystemExit(f"the command failed with status {process.returncode}")
        return seconds, peak / 2**20, words.read()


def main(args: Args) -> None:
    """Make the clips, measure them, and compare with the bars."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = args.folder or Path(scratch)
        dances = make(folder / "dances", args, seed=0)
        command = [sys.executable, "-m", "dancediff.cli", "evaluate", str(dances)]
        command += ["--workers", str(args.workers)]
        if args.reference:
            command += ["--reference", str(make(folder / "reference", args, seed=10**6))]
        seconds, gib, words = run(command)
    print(words)
    print(f"{args.clips} clips of {args.dancers} x {args.frames} frames, {args.workers} workers:")
    print(f"{seconds:.1f} s (bar {BAR_SECONDS}), {gib:.2f} GiB (bar {BAR_GIB})")


if __name__ == "__main__":
    main(tyro.cli(Args))
