r"""A joint tree with another rest pose, or made from where its joints are in the world.

Read first: `dancediff.data.bvh`.

Programs differ in the pose in which nothing counts as turned. Retargeting needs one in which a body
stands upright; any pose of a recording may be made that one, and no joint moves by it.

Symbols (axes: f frames · j joints)
    p, Q    positions and rotations in the world          (f, j, 3), (f, j, 3, 3)
    p0, Q0  the same in the pose that becomes the rest    (j, 3), (j, 3, 3)
"""

import torch
from torch import Tensor

from dancediff.data.bvh import BVH
from dancediff.motion.motion import Motion


def tree_from_world(
    names: tuple[str, ...], parents: tuple[int, ...], world: tuple[Tensor, Tensor],
    rest: tuple[Tensor, Tensor], fps: float,
) -> BVH:  # fmt: skip
    r"""The recording with these joints in the world that is not turned in the pose ``rest``.

    $$\hat Q_j = Q_j\, Q_{0,j}^\top,\quad R_j = \hat Q_{p(j)}^\top \hat Q_j,\quad
      o_j = p_{0,j} - p_{0,p(j)}$$

    Shapes: world (f, j, 3), (f, j, 3, 3); rest (j, 3), (j, 3, 3). Parents stand before children.
    """
    points, turned = world[0].double(), (world[1] @ rest[1].mT).double()
    at = torch.tensor([max(p, 0) for p in parents])
    has = torch.tensor([p >= 0 for p in parents])
    rotations = torch.where(has[:, None, None], turned[:, at].mT @ turned, turned)
    steps = (turned[:, at].mT @ (points - points[:, at])[..., None])[..., 0]
    rest_points = rest[0].double()
    return BVH(
        names=names,
        parents=parents,
        offsets=torch.where(has[:, None], rest_points - rest_points[at], 0.0),
        rotations=rotations,
        translations=torch.where(has[:, None], steps, points),
        fps=float(fps),
    )


def rest_at(bvh: BVH, frame: int) -> BVH:
    """The same recording with the pose of a frame as its rest; every joint stays where it is.

    >>> from dancediff.data.bvh import BVH
    >>> offsets = torch.tensor([[0.0, 0, 0], [0, 1, 0]]).double()
    >>> R = torch.eye(3).double().repeat(2, 2, 1, 1)
    >>> R[:, 0] = torch.tensor([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    >>> lying = BVH(("a", "b"), (-1, 0), offsets, R, offsets.repeat(2, 1, 1), 30.0)
    >>> other = rest_at(lying, 0)
    >>> other.offsets[1].tolist(), torch.equal(other.world()[0], lying.world()[0])
    ([0.0, 0.0, 1.0], True)
    """
    points, Q = bvh.world()
    rest = points[frame], Q[frame]
    return tree_from_world(bvh.names, bvh.parents, (points, Q), rest, bvh.fps)


def tree_of_motion(motion: Motion, k: int) -> BVH:
    """Dancer k of a `Motion` of any skeleton as a recording."""
    skeleton = motion.skeleton
    offsets = skeleton.offsets.double()
    moves = offsets.repeat(motion.num_frames, 1, 1)
    moves[:, 0] = motion.root[k].double()
    R = motion.pose[k].double()
    return BVH(tuple(skeleton.names), tuple(skeleton.parents), offsets, R, moves, motion.fps)
