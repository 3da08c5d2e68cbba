"""FineDance to prepared data: every step on one dance, then all of them.

    python data_prep/finedance.py FOLDER_WITH_motion OUT [--workers 2] [--split genre|dancer]

The last step is what `dancediff prepare finedance FOLDER OUT` does. Where to get the files, and
under which licence: data_prep/README.md.
"""

import argparse
from collections import Counter
from dataclasses import replace
from pathlib import Path

from dancediff.data.finedance import (
    IGNORED,
    SKIP,
    finedance_jobs,
    first_floor,
    read_motion,
    split_of,
)


def one_take(src: Path) -> None:
    """The steps behind the first dance, one by one."""
    # 1. which dances there are, and their splits; some are known to be broken
    jobs = finedance_jobs(src)
    print("left out:", *sorted(IGNORED))
    names = [job.name.removeprefix("finedance_") for job in jobs]
    print("dances:", dict(Counter(map(split_of, names))))
    name = names[0]

    # 2. read: 22 of the 52 joints, hands at rest, the path scaled to our longer legs
    motion = read_motion(src / "motion" / f"{name}.npy")
    print(f"{name}: {motion.num_frames} frames")

    # 3. cut a start in which little happens
    skip = SKIP.get(name, 0)
    motion = motion.frames(skip, motion.num_frames)
    print(f"{skip} frames cut from the start")

    # 4. the floor, taken from the first frame, goes to 0
    floor = first_floor(motion.joints())
    motion = replace(motion, root=motion.root - motion.root.new_tensor([0, floor, 0]))
    print(f"the floor was at {floor:.3f} m")

    # 5. music features of the whole song, cut like the motion, the genre's one name, contacts
    take = jobs[0].make()
    print(f"{take.motion.num_frames} frames, music: {take.music}, genre: {take.genre}")


def all_takes(src: Path, out: Path, workers: int, split: str) -> None:
    """Every take, as the command line does it."""
    from dancediff.data.prepare import prepare

    print(prepare(finedance_jobs(src, split=split), out, workers=workers))


def main() -> None:
    """Read the arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("src", type=Path, help="folder with motion/, music_wav/ and label_json/")
    parser.add_argument("out", type=Path, help="folder for the prepared data")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--split", default="genre", choices=("genre", "dancer"))
    args = parser.parse_args()
    one_take(args.src)
    all_takes(args.src, args.out, args.workers, args.split)


if __name__ == "__main__":
    main()
