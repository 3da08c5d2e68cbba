r"""The vector a network sees for one dancer in one frame, and its scaling to [-1, 1].

Read first: notebook 01 · TCDiff++ section 3.2.

Symbols (axes: n dancers · f frames · d motion features)
    x        contact, root and 6-D rotations side by side     (..., 151) or, in Lodge, (..., 139)
    contact  x[0:4]     0 or 1: left ankle, right ankle, left toe, right toe
    root     x[4:7]     metres: x lateral, y height, z depth
    rot6d    x[7:]      24 joints (Lodge 22) x first two rows of the rotation matrix
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from dancediff.motion.rotation import matrix_to_rot6d, rot6d_to_matrix
from dancediff.motion.skeleton import SMPL24, forward_kinematics


@dataclass(frozen=True)
class MotionSpec:
    """Named slices of a motion vector, so that no code needs a bare index."""

    name: str
    num_joints: int

    @property
    def contact(self) -> slice:
        """Where the four foot contacts live."""
        return slice(0, 4)

    @property
    def root(self) -> slice:
        """Where the pelvis position lives."""
        return slice(4, 7)

    @property
    def lateral(self) -> int:
        """The pelvis's place from left to right."""
        return self.root.start

    @property
    def height(self) -> int:
        """The pelvis's height."""
        return self.root.start + 1

    @property
    def floor(self) -> slice:
        """The pelvis's place on the floor, x and z."""
        return slice(self.root.start, self.root.stop, 2)

    @property
    def rot6d(self) -> slice:
        """Where the rotations live."""
        return slice(7, self.dim)

    @property
    def dim(self) -> int:
        """Length of the vector."""
        return 7 + 6 * self.num_joints

    def check(self, x: Tensor) -> None:
        """Refuse vectors of another length.

        Raises: ValueError naming both lengths.
        """
        if x.shape[-1] != self.dim:
            raise ValueError(f"x has {x.shape[-1]} features a frame; {self.name} needs {self.dim}")

    def joint_channels(self, joints) -> list[int]:
        """Channels of the 6-D rotations of some joints.

        >>> TCDIFFPP.joint_channels([0])
        [7, 8, 9, 10, 11, 12]
        """
        return [self.rot6d.start + 6 * j + k for j in joints for k in range(6)]


TCDIFFPP = MotionSpec("tcdiffpp", num_joints=24)  # the 151-d vector of EDGE, TCDiff and TCDiff++
LODGE = MotionSpec("lodge", num_joints=22)  # 139-d: the same without the two hands
_SPECS = {spec.name: spec for spec in (TCDIFFPP, LODGE)}


def spec_named(name: str) -> MotionSpec:
    """A motion vector by name.

    Raises: ValueError naming those that exist.

    >>> spec_named("lodge").dim
    139
    """
    if name not in _SPECS:
        known = ", ".join(map(repr, _SPECS))
        raise ValueError(f"features({name!r}) is unknown; available: {known}")
    return _SPECS[name]


def pack(contact: Tensor, root: Tensor, pose: Tensor) -> Tensor:
    """Put contact (..., 4), root (..., 3) and pose (..., j, 3, 3) into one vector (..., d).

    >>> pack(torch.zeros(4), torch.zeros(3), torch.eye(3).expand(24, 3, 3)).shape
    torch.Size([151])
    """
    return torch.cat([contact, root, matrix_to_rot6d(pose).flatten(-2)], dim=-1)


def unpack(x: Tensor, spec: MotionSpec = TCDIFFPP) -> tuple[Tensor, Tensor, Tensor]:
    """Split a vector (..., d) into contact (..., 4), root (..., 3) and pose (..., j, 3, 3).

    Any six numbers whose two rows are not parallel become a rotation, so a network's raw output may
    be unpacked.

    >>> contact, root, pose = unpack(torch.randn(2, 9, 151))
    >>> pose.shape
    torch.Size([2, 9, 24, 3, 3])
    """
    spec.check(x)
    rot6d = x[..., spec.rot6d].unflatten(-1, (spec.num_joints, 6))
    return x[..., spec.contact], x[..., spec.root], rot6d_to_matrix(rot6d)


def whole_pose(pose: Tensor) -> Tensor:
    """Give a pose the joints that its vector leaves out, not turned.

    Shapes: pose (..., j, 3, 3) -> (..., 24, 3, 3).

    >>> whole_pose(torch.eye(3).expand(2, 22, 3, 3)).shape
    torch.Size([2, 24, 3, 3])
    """
    missing = SMPL24.num_joints - pose.shape[-3]
    hands = torch.eye(3, dtype=pose.dtype, device=pose.device)
    return torch.cat([pose, hands.expand(*pose.shape[:-3], missing, 3, 3)], dim=-3)


def with_hands(x: Tensor) -> Tensor:
    """Add the two hands that Lodge leaves out, not turned; (..., 139) -> (..., 151).

    >>> with_hands(torch.zeros(2, 9, 139)).shape
    torch.Size([2, 9, 151])
    """
    missing = TCDIFFPP.num_joints - LODGE.num_joints  # the last ones, both
    hands = matrix_to_rot6d(torch.eye(3)).to(x).repeat(missing)
    return torch.cat([x, hands.expand(*x.shape[:-1], -1)], dim=-1)


def joints_of(x: Tensor, spec: MotionSpec = TCDIFFPP) -> Tensor:
    """Joint positions of motion vectors, by forward kinematics.

    The hands that Lodge's vector leaves out end a chain: no position depends on them.

    Shapes: x (..., d) metres and 6-D rotations -> (..., 24, 3) metres.

    >>> joints_of(torch.randn(2, 9, 139), LODGE).shape
    torch.Size([2, 9, 24, 3])
    """
    _, root, pose = unpack(x, spec)
    return forward_kinematics(whole_pose(pose), root)


def at_origin(x: Tensor, spec: MotionSpec = TCDIFFPP) -> Tensor:
    """Move each clip so that its root starts at x = z = 0; a copy, heights unchanged.

    Shapes: x (..., f, d) metres -> (..., f, d).

    >>> x = torch.ones(2, 5, 139)
    >>> at_origin(x)[1, :, 4:7].unique(dim=0).tolist(), x.min().item()
    ([[0.0, 1.0, 0.0]], 1.0)
    """
    y = x.clone()
    y[..., spec.root] -= x[..., :1, spec.root] * x.new_tensor([1.0, 0.0, 1.0])
    return y


class Normalizer(nn.Module):
    r"""Scale each channel to [-1, 1] by the smallest and largest value of the training set.

    $$\tilde x = 2\,\frac{x - \text{low}}{\text{high} - \text{low}} - 1$$

    Source: EDGE, Lodge.  Differs: the released TCDiff++ refits it for every clip, which takes the
    metres out of all distances; ours is fitted once.  Constant channels get scale 1.

    Shapes: low, high (d,); x (..., d).

    >>> norm = Normalizer.fit(torch.tensor([[0.0, 5.0], [4.0, 5.0]]))
    >>> norm.normalize(torch.tensor([1.0, 5.0])).tolist()
    [-0.5, -1.0]
    >>> norm.unnormalize(norm.normalize(torch.tensor([3.0, 5.0]))).tolist()
    [3.0, 5.0]
    """

    def __init__(self, low: Tensor, high: Tensor):
        super().__init__()
        if low.shape != high.shape or low.ndim != 1:
            raise ValueError(f"low {tuple(low.shape)} and high {tuple(high.shape)} must be (d,)")
        self.register_buffer("low", low.clone().float())
        self.register_buffer("high", high.clone().float())

    low: Tensor
    high: Tensor

    @classmethod
    def fit(cls, x: Tensor, *, min_span: float = 0.0) -> "Normalizer":
        """Take the extremes of x (..., d) over everything but the last axis.

        ``min_span`` widens narrower ranges about their middle: without it a matrix entry that
        only ever moves between 0.996 and 1 weighs as much in a loss as a knee.

        Raises: ValueError for no row, or values that are not finite: one of them hides all others.
        """
        flat = x.reshape(-1, x.shape[-1])
        if not (len(flat) and flat.isfinite().all()):
            raise ValueError(f"x {tuple(x.shape)} has no row, or NaN or infinite values; repair it")
        low, high = flat.amin(0), flat.amax(0)
        wider = ((min_span - (high - low)) / 2).clamp_min(0) * (high - low > 1e-6)
        return cls(low - wider, high + wider)

    def on_cpu(self) -> "Normalizer":
        """The same for tensors of the CPU, whatever device this one is on."""
        return Normalizer(self.low.cpu(), self.high.cpu())

    @property
    def scale(self) -> Tensor:
        """Half the range of each channel (1 where it is constant): units per normalised unit."""
        span = self.high - self.low
        return torch.where(span > 1e-6, span, torch.full_like(span, 2.0)) / 2

    def normalize(self, x: Tensor) -> Tensor:
        """Into [-1, 1] on the training range; values beyond it go beyond it."""
        return (x - self.low) / self.scale - 1

    def unnormalize(self, x: Tensor) -> Tensor:
        """Back to metres and rotations."""
        return (x + 1) * self.scale + self.low


def cut_to_range(x: Tensor) -> Tensor:
    """Cut normalised features at +-1, the training range, but for places on the floor.

    Source: EDGE, Lodge.  Differs: they cut places, too; here who stands further out than anybody in
    training, or than a metre with `metre_unit`, shall not be pulled in.

    Shapes: x (..., d) -> the same.

    >>> cut_to_range(3 * torch.ones(151))[3:8].tolist()  # a contact, the root, a rotation
    [1.0, 3.0, 1.0, 3.0, 1.0]
    """
    cut = x.clamp(-1, 1)
    cut[..., TCDIFFPP.floor] = x[..., TCDIFFPP.floor]  # Lodge's vector has the same
    return cut
