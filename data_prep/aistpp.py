"""AIST++ to prepared data: every step on one take, then all of them.

    python data_prep/aistpp.py FOLDER_WITH_motions OUT [--workers 2]

The last step is what `dancediff prepare aistpp FOLDER OUT` does. Where to get the files, and under
which licence: data_prep/README.md.
"""

import argparse
from pathlib import Path

from dancediff.data.aistpp import RECORDED_FPS, aistpp_jobs, music_id, music_tempo, read_poses
from dancediff.data.formats import on_the_floor, smpl_motion
from dancediff.data.safe_pickle import load_pickle


def one_take(src: Path) -> None:
    """The steps behind the first take, one by one."""
    # 1. the takes of the three lists, without the ignored ones
    jobs = aistpp_jobs(src)
    name = jobs[0].name.removeprefix("aistpp_")
    print(f"{len(jobs)} takes, first {name}")

    # 2. read the pickle without running it
    data = load_pickle(src / "motions" / f"{name}.pkl")
    print(f"it holds {', '.join(data)}")

    # 3. axis-angle vectors, and the root's path divided by the scaling
    poses, trans = read_poses(data)
    print(f"poses {poses.shape}, path {trans.shape}, {RECORDED_FPS} frames a second")

    # 4. to rotation matrices, every other frame
    motion = smpl_motion(poses, trans, RECORDED_FPS)
    print(f"{motion.num_frames} frames, {motion.fps} a second")

    # 5. the floor at 0
    motion, floors = on_the_floor(motion)
    print("the floor was at", floors, "m")

    # 6. music features, cut to the length both have, and contacts
    take = jobs[0].make()
    music = music_id(name)
    print(f"{music} at {music_tempo(music)} beats a minute; music: {take.music}")


def all_takes(src: Path, out: Path, workers: int) -> None:
    """Every take, as the command line does it."""
    from dancediff.data.prepare import prepare

    print(prepare(aistpp_jobs(src), out, workers=workers))


def main() -> None:
    """Read the arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("src", type=Path, help="folder with motions/, splits/ and wavs/")
    parser.add_argument("out", type=Path, help="folder for the prepared data")
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    one_take(args.src)
    all_takes(args.src, args.out, args.workers)


if __name__ == "__main__":
    main()
