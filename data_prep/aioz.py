"""AIOZ-GDance to prepared data: every step on one take, then all of them.

    python data_prep/aioz.py FOLDER_WITH_motions_smpl OUT [--workers 2]

The last step is what `dancediff prepare aioz FOLDER OUT` does. Where to get the files, and under
which licence: data_prep/README.md.
"""

import argparse
from collections import Counter
from pathlib import Path

from dancediff.data.aioz import FPS, aioz_jobs, read_poses
from dancediff.data.formats import on_the_floor, read_splits, smpl_motion
from dancediff.data.safe_pickle import load_pickle
from dancediff.data.take import SPLITS


def one_take(src: Path) -> None:
    """The steps behind the first take of the lists, one by one."""
    # 1. which take belongs to which split
    splits = read_splits({split: src / f"{split}_split_sequence_names.txt" for split in SPLITS})
    print("takes in the lists:", dict(Counter(splits.values())))
    name = next(iter(splits))

    # 2. read the pickle without running it
    data = load_pickle(src / "motions_smpl" / f"{name}.pkl")
    print(f"{name} holds {', '.join(data)}")

    # 3. axis-angle vectors of 24 joints, hands padded where they are missing, and the root's path
    poses, trans = read_poses(data)
    print(f"poses {poses.shape}, path {trans.shape}")

    # 4. to rotation matrices, cut to the shorter of the two
    motion = smpl_motion(poses, trans, FPS)
    print(f"{motion.num_dancers} dancers, {motion.duration:.1f} s")

    # 5. every dancer's floor at 0
    motion, floors = on_the_floor(motion)
    print("the floors were at", floors, "m")

    # 6. music features, cut to the length both have, and contacts
    take = next(job for job in aioz_jobs(src) if job.name == f"aioz_{name}").make()
    print(f"{take.motion.num_frames} frames, music: {take.music}, genre: {take.genre}")


def all_takes(src: Path, out: Path, workers: int) -> None:
    """Every take, as the command line does it."""
    from dancediff.data.prepare import prepare

    print(prepare(aioz_jobs(src), out, workers=workers))


def main() -> None:
    """Read the arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("src", type=Path, help="folder with motions_smpl/, musics/ and the lists")
    parser.add_argument("out", type=Path, help="folder for the prepared data")
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    one_take(args.src)
    all_takes(args.src, args.out, args.workers)


if __name__ == "__main__":
    main()
