r"""The SMPL-24 joint tree and forward kinematics.

Read first: notebook 01.

Symbols (axes: n dancers · f frames · j joints)
    pose    rotation of each joint relative to its parent   (..., j, 3, 3)
    root    position of the pelvis, metres                  (..., 3)
    joints  positions of all joints, metres                 (..., j, 3)
    offsets where a joint sits on its parent, metres        (j, 3)   x body-left, y up, z forward
"""

from dataclasses import dataclass, field

import torch
from torch import Tensor

from dancediff.lookup import table

# fmt: off
_SMPL24 = [  # name, parent, rest offset from the parent in metres (SMPL axes)
    ("root", -1, (0, 0, 0)),
    ("lhip", 0, (0.05858135, -0.08228004, -0.01766408)),
    ("rhip", 0, (-0.06030973, -0.09051332, -0.01354254)),
    ("belly", 0, (0.00443945, 0.12440352, -0.03838522)),
    ("lknee", 1, (0.04345142, -0.38646945, 0.008037)),
    ("rknee", 2, (-0.04325663, -0.38368791, -0.00484304)),
    ("spine", 3, (0.00448844, 0.1379564, 0.02682033)),
    ("lankle", 4, (-0.01479032, -0.42687458, -0.037428)),
    ("rankle", 5, (0.01905555, -0.4200455, -0.03456167)),
    ("chest", 6, (-0.00226458, 0.05603239, 0.00285505)),
    ("ltoe", 7, (0.04105436, -0.06028581, 0.12204243)),
    ("rtoe", 8, (-0.03483987, -0.06210566, 0.13032329)),
    ("neck", 9, (-0.0133902, 0.21163553, -0.03346758)),
    ("lcollar", 9, (0.07170245, 0.11399969, -0.01889817)),
    ("rcollar", 9, (-0.08295366, 0.11247234, -0.02370739)),
    ("head", 12, (0.01011321, 0.08893734, 0.05040987)),
    ("lshoulder", 13, (0.12292141, 0.04520509, -0.019046)),
    ("rshoulder", 14, (-0.11322832, 0.04685326, -0.00847207)),
    ("lelbow", 16, (0.2553319, -0.01564902, -0.02294649)),
    ("relbow", 17, (-0.26012748, -0.01436928, -0.03126873)),
    ("lwrist", 18, (0.26570925, 0.01269811, -0.00737473)),
    ("rwrist", 19, (-0.26910836, 0.00679372, -0.00602676)),
    ("lhand", 20, (0.08669055, -0.01063603, -0.01559429)),
    ("rhand", 21, (-0.0887537, -0.00865157, -0.01010708)),
]
# fmt: on


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A joint tree: names, parents (-1 for the root) and rest offsets in metres."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Tensor = field(repr=False)

    @property
    def num_joints(self) -> int:
        """How many joints the tree has."""
        return len(self.names)

    @property
    def bones(self) -> list[tuple[int, int]]:
        """All (parent, child) pairs, for drawing."""
        return [(p, j) for j, p in enumerate(self.parents) if p >= 0]

    def is_like(self, other: "Skeleton") -> bool:
        """Has another body the same joints, tree and bone lengths, to a hundredth of a millimetre?

        >>> longer = Skeleton(SMPL24.names, SMPL24.parents, 1.1 * SMPL24.offsets)
        >>> SMPL24.is_like(SMPL24), SMPL24.is_like(longer)
        (True, False)
        """
        if (self.names, self.parents) != (other.names, other.parents):
            return False
        bones = slice(1, None)  # the root has none: its offset is where a file puts it
        return bool((self.offsets - other.offsets)[bones].abs().max() < 1e-5)

    def index(self, name: str) -> int:
        """Index of a joint by name.

        Raises: ValueError naming the joint and those that exist.

        >>> SMPL24.index("ltoe")
        10
        """
        if name not in self.names:
            raise ValueError(f"joint {name!r} is unknown; known joints: {', '.join(self.names)}")
        return self.names.index(name)


SMPL24 = Skeleton(
    names=tuple(name for name, _, _ in _SMPL24),
    parents=tuple(parent for _, parent, _ in _SMPL24),
    offsets=torch.tensor([offset for _, _, offset in _SMPL24], dtype=torch.float32),
)
FOOT_JOINTS = (7, 8, 10, 11)  # left ankle, right ankle, left toe, right toe
LOWER_BODY = (1, 2, 4, 5, 7, 8, 10, 11)  # TCDiff++ footwork: hips, knees, ankles, toes


def feet_of(joints: Tensor) -> Tensor:
    """The joints `FOOT_JOINTS` of all: (..., 24, 3) -> (..., 4, 3).

    >>> torch.equal(feet_of(torch.arange(24)[:, None])[:, 0], torch.tensor(FOOT_JOINTS))
    True
    """
    return torch.stack([joints[..., j, :] for j in FOOT_JOINTS], dim=-2)


def world_rotations(pose: Tensor, skeleton: Skeleton = SMPL24) -> Tensor:
    r"""Rotation of every joint in the world: $Q_0 = R_0,\; Q_j = Q_{p(j)} R_j$.

    Shapes: pose (..., j, 3, 3) -> (..., j, 3, 3).

    >>> world_rotations(torch.eye(3).expand(24, 3, 3)).shape
    torch.Size([24, 3, 3])
    """
    world: list = [None] * skeleton.num_joints
    local = pose.unbind(-3)
    for j, p in enumerate(skeleton.parents):
        world[j] = local[j] if p < 0 else world[p] @ local[j]
    return torch.stack(world, dim=-3)


def forward_kinematics(pose: Tensor, root: Tensor, skeleton: Skeleton = SMPL24) -> Tensor:
    r"""Where every joint is in the world.

    $$p_0 = \text{root},\quad p_j = p_{p(j)} + Q_{p(j)}\, o_j,\quad Q_j = Q_{p(j)} R_j$$

    Source: TCDiff++ eq. 13 and Lodge eq. 3 use it as FK(.).  Differs: works on matrices directly;
    the official codes go through axis-angle, whose gradient breaks near half turns.

    Shapes: pose (..., j, 3, 3), root (..., 3) metres -> (..., j, 3) metres.

    >>> joints = forward_kinematics(torch.eye(3).expand(24, 3, 3), torch.zeros(3))
    >>> round(joints[15, 1].item(), 3)                       # the head of the T-pose
    0.619
    """
    offsets = table(_rest, skeleton, like=root).unbind(0)
    rotations = pose.unbind(-3)  # one autograd node; indexing joint by joint would make 24
    Q: list = []
    joints: list = []
    for j, p in enumerate(skeleton.parents):
        if p < 0:
            Q.append(rotations[j])
            joints.append(root)
        else:
            joints.append(joints[p] + (Q[p] * offsets[j]).sum(-1))  # @ rounds by batch size
            Q.append(Q[p] @ rotations[j])
    return torch.stack(joints, dim=-2)


def _rest(skeleton: Skeleton) -> Tensor:
    return skeleton.offsets
