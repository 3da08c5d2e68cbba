"""Solutions of lesson 01."""

# %% 01.1
# A joint's own rotation stands in the sum of its children, Q_p o_j, and not in its own place: an
# elbow that bends stays where it is. A hand has no children, so nothing moves; that is why Lodge
# leaves the hands out. The root carries all the others.
moved = {"18 left elbow": 2, "22 left hand": 0, "9 chest": 12, "0 root": 23}


# %% 01.2
# In the world the shoulder is turned by Q[13] @ R[16]. The inverse of Q[13], its transpose, undoes
# whatever the body does, and the quarter turn points the arm up. It stays straight only if elbow
# and wrist do.
from torch import eye, pi, tensor

from dancediff.motion import rotation, skeleton


def raise_hand(pose):
    pose = pose.clone()
    pose[[18, 20]] = eye(3)
    Q = skeleton.world_rotations(pose)
    pose[16] = Q[13].mT @ rotation.rotation_about("z", tensor(pi / 2))
    return pose


# %% 01.3
# A rotation matrix has rows of length one that stand at right angles. Two of them say it all: the
# third is their cross product. Six numbers that are no such rows yet are pulled straight first.
import torch
from torch.nn.functional import normalize


def six_to_matrix(d6):
    first = normalize(d6[..., :3], dim=-1)
    second = d6[..., 3:] - (first * d6[..., 3:]).sum(-1, keepdim=True) * first
    second = normalize(second, dim=-1)
    return torch.stack([first, second, torch.linalg.cross(first, second)], dim=-2)


# %% 01.4
# The rows of each are nearly parallel. Once the second has lost its share of the first, four
# thousandths are left, and making them unit length blows them up: their sign decides where the
# second row points. Dances are full of rows at right angles, so a trained network stays far away.
def two_near():
    return [1.0, 0, 0, 1, 0.004, 0], [1.0, 0, 0, 1, -0.004, 0]


# %% 01.5
# A rotation is not a number to be mixed: halfway between two matrices, or between two vectors on
# both sides of the jump, lies something else. The turn from one to the next is small, so a share of
# it is safe. Where a new frame falls on an old one the share is 0; whole numbers say so exactly.
import torch

from dancediff.motion import rotation


def resample(x, old, new):
    last = x.shape[1] - 1
    at = torch.arange(last * new // old + 1) * old
    k, w = at // new, (at % new / new)[:, None]
    now, then = x[:, k], x[:, (k + 1).clamp(max=last)]
    root = torch.lerp(now[..., 4:7], then[..., 4:7], w)
    d6 = [y[..., 7:].unflatten(-1, (24, 6)) for y in (now, then)]
    R, R_then = map(rotation.rot6d_to_matrix, d6)
    turn = rotation.matrix_to_axis_angle(R.mT @ R_then)
    R = R @ rotation.axis_angle_to_matrix(w[..., None] * turn)
    rotations = rotation.matrix_to_rot6d(R).flatten(-2)
    return torch.cat([now[..., :4], root, rotations], dim=-1)
