"""The choreographer to prepared data: every step of one dance, then as many as you like.

    python data_prep/choreograph.py 2000 OUT [--workers 2] [--seconds 10] [--seed 0]

The last step is what `dancediff prepare choreograph 2000 OUT` does. Nothing is read: songs and
dances follow from seeds, and every number measured on them is a number about synthetic data.
"""

import argparse
from collections import Counter
from pathlib import Path

import numpy as np

from dancediff.data.choreographed import choreograph_jobs, genre_and_tempo
from dancediff.data.choreographer import choreograph
from dancediff.data.sources import REPEATS
from dancediff.music.varied import synth_varied_song


def one_take(seed: int, seconds: float) -> None:
    """The steps behind a trio to the first song, one by one."""
    # 1. a genre, and a tempo that suits it
    genre, tempo = genre_and_tempo(seed)
    print(f"song {seed}: {genre} at {tempo} beats a minute")

    # 2. a song that begins in that tempo; the synthesiser knows its beats and sections
    song, heard = synth_varied_song(seed, seconds=seconds, tempo=tempo)
    print(f"{len(heard.beats)} beats, sections:", *(label for _, _, label in heard.sections))

    # 3. a dance on these beats, with contacts, formations and order known exactly
    options = {"seconds": seconds, "genre": genre, "sections": heard.sections}
    options["meter"] = heard.meter
    dance, truth = choreograph(heard.beats, dancers=3, seed=10 * seed + 3, **options)
    print(f"{dance.num_dancers} dancers, {dance.duration:.1f} s")
    print("formations:", *(f"{name} at {frame / 30:.1f} s" for frame, name, _ in truth.formations))
    print(f"order {truth.order_start} at the start, {truth.order_end} at the end")
    gaps = [
        np.linalg.norm(dance.root[i, :, (0, 2)] - dance.root[j, :, (0, 2)], axis=-1).min()
        for i, j in ((0, 1), (0, 2), (1, 2))
    ]
    print(f"nobody comes closer than {min(gaps):.2f} m")

    # 4. what a network hears of the song: 35 numbers a frame
    print(f"music features: {tuple(song.features().shape)}")


def all_takes(num: int, out: Path, workers: int, seconds: float, seed: int) -> None:
    """Every take, as the command line does it."""
    from dancediff.data.prepare import prepare

    jobs = choreograph_jobs(num, seconds=seconds, seed=seed, repeats=REPEATS, varied=True)
    print("dances by group size:", dict(Counter(job.make.args[2] for job in jobs)))
    print(prepare(jobs, out, workers=workers))


def main() -> None:
    """Read the arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("num", type=int, help="how many dances")
    parser.add_argument("out", type=Path, help="folder for the prepared data")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0, help="the first song")
    args = parser.parse_args()
    one_take(args.seed, args.seconds)
    all_takes(args.num, args.out, args.workers, args.seconds, args.seed)


if __name__ == "__main__":
    main()
