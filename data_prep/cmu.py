"""CMU motion capture to prepared data: every step on one take, then all of them.

    python data_prep/cmu.py FOLDER_WITH_MANIFEST OUT [--workers 2] [--figures docs/images]

The last step is what `dancediff prepare cmu FOLDER OUT` does. Where to get the files, and under
which licence: data_prep/README.md. ``--figures`` also draws source and result of five takes side
by side.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import torch

from dancediff.data.bvh import read_bvh
from dancediff.data.cmu import LEAD, cmu_jobs
from dancediff.data.joint_maps import find_joints
from dancediff.data.repair import repair
from dancediff.data.retarget import FPS, floor_height, leg_scale, resample, retarget
from dancediff.motion.skeleton import SMPL24
from dancediff.viz.style import save_figure

FIGURES = ("salsa_01", "salsa_06", "salsa_09", "indian_07", "indian_14")
MOMENTS = (0.1, 0.26, 0.42, 0.58, 0.74, 0.9)  # of a take


def one_take(src: Path) -> None:
    """The steps behind one dancer of the first duet, one by one."""
    manifest = json.loads((src / "manifest.json").read_text(encoding="utf-8"))
    row, fps = manifest["salsa"]["pairs"][0], manifest["salsa"]["fps_true"]

    # 1. read; the header says 120 frames a second, the music of the dance says 60
    bvh = read_bvh(src / row["a"], fps=fps)
    print(f"{row['a']}: {bvh.num_frames} frames of {len(bvh.names)} joints, {bvh.fps:g} a second")

    # 2. drop the T-pose and what the conversion's filter smeared it into
    bvh = bvh.frames(LEAD)

    # 3. which joint plays which: names of SMPL-24 to names of the file
    joints = find_joints(bvh.names, "cmu")
    print("left arm:", {ours: joints[ours] for ours in ("lshoulder", "lelbow", "lwrist")})

    # 4. repair what no body did, then come to 30 frames a second
    repaired, done = repair(bvh, joints)
    for entry in done:
        print("repaired:", entry)
    print(f"{resample(repaired, FPS).num_frames} frames at {FPS:g} a second")

    # 5. onto SMPL-24: directions kept, lengths scaled by the legs, floor at 0 (repairs included)
    motion, numbers = retarget(bvh, "cmu", scale=leg_scale(bvh, joints))
    print(f"{motion.num_frames} frames, feet on the floor {motion.contact.mean():.0%} of the time")
    for key in ("scale", "direction_error", "skating_source", "skating", "penetration_p95"):
        print(f"    {key:16} {numbers[key]:.4f}")


def all_takes(src: Path, out: Path, workers: int) -> None:
    """Every take of the manifest, with music and composed groups, as the command line does it."""
    from dancediff.data.sources import prepare_source

    print(prepare_source("cmu", src, out, workers=workers))


def draw_take(src: Path, name: str, path: Path) -> Path:
    """Source above result at six moments of a take, from the same place, at the same scale."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    take = next(job for job in cmu_jobs(src) if job.name == name).make()
    result = take.motion.joints().numpy()
    source, bones = _source_joints(src, name, take, result)
    moments = [int(moment * take.motion.num_frames) for moment in MOMENTS]
    middles = result[:, moments, 0].mean(0) * (1, 0, 1)
    reach = np.abs(_seen(result[:, moments] - middles[:, None]))[..., 0].max() + 0.1
    figure = Figure(figsize=(12, 0.8 + 8.4 / (2 * reach)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, len(MOMENTS), sharex=True, sharey=True)
    axes[0, 0].set(xlim=(-reach, reach), ylim=(-0.15, 1.95))
    for column, (f, middle) in enumerate(zip(moments, middles, strict=True)):
        _draw(axes[0, column], source[:, f] - middle, bones)
        _draw(axes[1, column], result[:, f] - middle, SMPL24.bones)
        axes[0, column].set_title(f"{f / FPS:.1f} s", fontsize=9)
    axes[0, 0].set_ylabel("source, metres")
    axes[1, 0].set_ylabel("SMPL-24, metres")
    error = take.notes["direction_error"]
    figure.suptitle(f"{name}: limbs point where they pointed (mean error {error:.1f} degrees)")
    save_figure(figure, path, dpi=80)
    return path


def _source_joints(src: Path, name: str, take, result: np.ndarray):
    """The source's own joints, scaled and shifted onto the stage: (n, f, j, 3), and its bones."""
    manifest = json.loads((src / "manifest.json").read_text(encoding="utf-8"))
    genre, number = name.split("_")
    rows = manifest[genre]["pairs" if genre == "salsa" else "takes"]
    row = next(row for row in rows if row["take"] == int(number))
    dancers = []
    for key in ("a", "b") if genre == "salsa" else ("file",):
        bvh = read_bvh(src / row[key], fps=manifest[genre]["fps_true"]).frames(LEAD)
        points = take.notes["scale"] * resample(bvh, FPS).world()[0]
        feet = [bvh.index(joint) for joint in ("lFoot", "rFoot", "lFoot_end", "rFoot_end")]
        points[..., 1] -= floor_height(points[:, feet])
        dancers.append(points)
    small = ("Eye", "Thumb", "Index", "Ring", "Pinky")
    drawn = [
        (p, j)
        for j, p in enumerate(bvh.parents)
        if p >= 0 and not any(part in bvh.names[j] for part in small)
    ]
    source = torch.stack(dancers)[:, : result.shape[1]].numpy()
    source[..., (0, 2)] += (result[:, :, :1] - source[:, :, :1])[..., (0, 2)].mean((0, 1))
    return source, drawn


def _seen(points: np.ndarray) -> np.ndarray:
    """From metres to the picture: from the front, a little from the side and from above."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    return np.stack([0.94 * x - 0.34 * z, y - 0.1 * (0.34 * x + 0.94 * z)], -1)


def _draw(ax, joints: np.ndarray, bones) -> None:
    """Sticks, one colour per dancer; joints (n, j, 3)."""
    from matplotlib.collections import LineCollection

    xy = _seen(joints)
    for k, color in enumerate(("#0072B2", "#E69F00")[: len(joints)]):
        lines = [xy[k, list(bone)] for bone in bones]
        ax.add_collection(LineCollection(lines, colors=color, linewidths=1.6, capstyle="round"))
    ax.axhline(0, color="#B9C0C9", linewidth=0.8, zorder=0)
    ax.set_aspect("equal")
    ax.tick_params(labelsize=7)
    ax.spines[["top", "right"]].set_visible(False)


def main() -> None:
    """Read the arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("src", type=Path, help="folder with manifest.json, salsa/ and indian/")
    parser.add_argument("out", type=Path, help="folder for the prepared data")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--figures", type=Path, help="folder for retarget_<take>.png")
    args = parser.parse_args()
    one_take(args.src)
    if args.figures:
        for name in FIGURES:
            print(draw_take(args.src, name, args.figures / f"retarget_{name}.png"))
    all_takes(args.src, args.out, args.workers)


if __name__ == "__main__":
    main()
