"""Anybody's motion capture to prepared data: every step on one BVH file, then a whole folder.

    python data_prep/folder.py FOLDER OUT [--fps 60] [--workers 2]

The last step is what `dancediff prepare folder FOLDER OUT` does. To try it: the CMU dances, whose
salsa headers say 120 frames a second where 60 is right (data_prep/README.md).
"""

import argparse
from pathlib import Path

from dancediff.data.bvh import read_bvh
from dancediff.data.folder.posture import Given, settle
from dancediff.data.retarget import leg_scale, retarget
from dancediff.data.sources import prepare_source
from dancediff.viz.source_and_result import draw_source_and_result


def one_file(path: Path, fps: float | None) -> None:
    """The steps behind one dancer, one by one."""
    # 1. read, in whatever unit and with whatever axis up
    bvh = read_bvh(path, fps=fps, scale=1.0)
    print(f"{path.name}: {bvh.num_frames} frames of {len(bvh.names)} joints")

    # 2. find out what the file does not say: which joint is which, what is up, the unit, the rest
    found = settle(bvh, Given(fps=fps))
    print(found.facts)
    print("left arm:", {ours: found.joints[ours] for ours in ("lshoulder", "lelbow", "lwrist")})
    for words in (*found.repaired, *found.doubts):
        print("look at this:", words)

    # 3. leave out what fades from a T-pose put before the take
    bvh = found.bvh.frames(found.lead)

    # 4. onto SMPL-24 at 30 frames a second, feet on the floor
    motion, numbers = retarget(bvh, found.joints, scale=leg_scale(bvh, found.joints))
    print(f"{motion.num_frames} frames; limbs are {numbers['direction_error']:.2f} degrees off")


def main() -> None:
    """Read the arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("src", type=Path, help="folder with BVH, glTF, SMPL or .npz files")
    parser.add_argument("out", type=Path, help="folder for the prepared data")
    parser.add_argument("--fps", type=float, help="the true frame rate where the files' is wrong")
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    if files := sorted(args.src.rglob("*.bvh")):
        one_file(files[0], args.fps)
    how = {"fps": args.fps, "workers": args.workers, "draw": draw_source_and_result}
    print(prepare_source("folder", args.src, args.out, **how))


if __name__ == "__main__":
    main()
