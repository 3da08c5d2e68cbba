r"""BVH, the format of motion capture programs: one dancer a file, and back.

Symbols (axes: f frames · j = 24 joints)
    pose    rotation of each joint relative to its parent    (f, j, 3, 3)
    angles  degrees about z, x, y, applied in this order     (f, j, 3)
"""

from pathlib import Path

import torch
from torch import Tensor

from dancediff.atomic import write_text
from dancediff.data.bvh import CENTIMETRE, END, read_bvh
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import rotation_about
from dancediff.motion.skeleton import SMPL24, Skeleton

SAME = 1e-4  # metres by which written offsets may differ: a file has six digits


def save_bvh(motion: Motion, path) -> Path:
    r"""Write one dancer as BVH: channels Z X Y, in centimetres.

    The file appears whole or not at all. `load_bvh` gives the joints back within 1 mm, but not
    ``meta``: BVH has no place to say that a dance is synthetic.

    Raises: ValueError for more than one dancer; pick one with ``motion.dancer(k)``.
    """
    if motion.num_dancers != 1:
        raise ValueError(
            f"motion has {motion.num_dancers} dancers and a BVH file holds one; "
            "write motion.dancer(k) for each k"
        )
    header, order = _tree_text(motion.skeleton)
    angles = _euler_zxy(motion.pose[0].double())[:, order].flatten(1)
    rows = torch.cat([motion.root[0].double() / CENTIMETRE, angles], 1).numpy()
    times = [f"Frames: {motion.num_frames}", f"Frame Time: {1 / motion.fps:.9f}"]
    frames = (" ".join(f"{value:.5f}" for value in row) for row in rows)
    path = Path(path)
    write_text(path, "\n".join([*header, "MOTION", *times, *frames, ""]))
    return path


def load_bvh(path) -> Motion:
    """Read a BVH file with the joint tree that `save_bvh` writes; a solo.

    Other trees, such as those of a motion capture studio, are read by `dancediff prepare folder`.

    Raises: FileNotFoundError, or ValueError naming the file and what is wrong with it.
    """
    try:
        bvh = read_bvh(path)
    except ValueError as err:
        raise ValueError(f"{path}: {err}") from err
    own = [j for j, name in enumerate(bvh.names) if not name.endswith(END)]
    places = {bvh.names[j]: j for j in own}
    if set(places) != set(SMPL24.names):
        raise ValueError(
            f"{path} has the joints {', '.join(places)}, not those of SMPL-24 as dancediff writes "
            "them; `dancediff prepare folder` reads any body, see docs/your_own.md"
        )
    index = [places[name] for name in SMPL24.names]
    parents = [-1 if bvh.parents[j] < 0 else index.index(bvh.parents[j]) for j in index]
    offsets = bvh.offsets[index].float()
    known = (offsets[1:] - SMPL24.offsets[1:]).abs().max() < SAME
    if tuple(parents) != SMPL24.parents:
        raise ValueError(f"{path} has the joints of SMPL-24 in another tree")
    return Motion(
        bvh.rotations[None, :, index],
        bvh.root[None],
        usual_rate(bvh.fps),
        skeleton=SMPL24 if known else Skeleton(SMPL24.names, SMPL24.parents, offsets),
        meta={"source": "bvh"},
    )


def usual_rate(fps: float) -> float:
    """The rate that a header means: programs write the time of a frame with six digits.

    >>> usual_rate(1 / 0.033333), usual_rate(1 / 0.008333), round(usual_rate(1 / 0.0417083), 3)
    (30.0, 120.0, 23.976)
    """
    known = [float(round(fps)), *(k * 1000 / 1001 for k in (24, 30, 60, 120))]
    near = [rate for rate in known if rate >= 1 and abs(1 / rate - 1 / fps) < 6e-7]
    return near[0] if near else round(fps, 4)


def _euler_zxy(R: Tensor) -> Tensor:
    r"""Angles with $R = R_z(a) R_x(b) R_y(c)$, degrees, (..., 3, 3) -> (..., 3).

    b and c are read after a is taken off, so that the product is right at b = 90 degrees too.
    """
    a = torch.atan2(-R[..., 0, 1], R[..., 1, 1])
    rest = rotation_about("z", -a) @ R
    b = torch.atan2(rest[..., 2, 1], rest[..., 1, 1])
    c = torch.atan2(rest[..., 0, 2], rest[..., 0, 0])
    return torch.rad2deg(torch.stack([a, b, c], -1))


def _tree_text(skeleton) -> tuple[list[str], list[int]]:
    """The HIERARCHY part, and the joints in the order in which it names them: depth first."""
    place = [
        " ".join(f"{x:.6f}" for x in offset / CENTIMETRE) for offset in skeleton.offsets.double()
    ]
    order: list[int] = []

    def lines(j: int) -> list[str]:
        order.append(j)
        children = [k for k, p in enumerate(skeleton.parents) if p == j]
        where = "3" if j else "6 Xposition Yposition Zposition"
        inside = [f"OFFSET {place[j]}", f"CHANNELS {where} Zrotation Xrotation Yrotation"]
        inside += [row for k in children for row in lines(k)]
        if not children:
            inside += ["End Site", "{", "\tOFFSET 0.000000 0.000000 0.000000", "}"]
        head = f"{'JOINT' if j else 'ROOT'} {skeleton.names[j]}"
        return [head, "{", *(f"\t{row}" for row in inside), "}"]

    return ["HIERARCHY", *lines(0)], order
