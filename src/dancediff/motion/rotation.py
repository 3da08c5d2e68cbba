r"""Rotations as matrices, as 6 numbers and as axis-angle vectors.

Read first: notebook 01 · Zhou et al. 2019, "On the continuity of rotation representations".

Symbols
    R     rotation matrix               (..., 3, 3)
    d6    its first two ROWS, flat      (..., 6)      identity = (1, 0, 0, 0, 1, 0)
    v     axis-angle vector, radians    (..., 3)
"""

from functools import partial

import roma
import torch
import torch.nn.functional as F
from torch import Tensor


def matrix_to_rot6d(R: Tensor) -> Tensor:
    r"""Keep the first two rows of a rotation matrix.

    $$d_6 = (R_{00}, R_{01}, R_{02}, R_{10}, R_{11}, R_{12})$$

    Source: Zhou et al. 2019, eq. 15 (they write columns; every dance code base stores rows).

    Shapes: R (..., 3, 3) -> (..., 6).

    >>> matrix_to_rot6d(torch.eye(3)).tolist()
    [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    """
    return R[..., :2, :].flatten(-2)


def rot6d_to_matrix(d6: Tensor) -> Tensor:
    r"""Turn six numbers into a rotation matrix by Gram-Schmidt on two rows.

    $$b_1 = \hat a_1,\quad b_2 = \widehat{a_2 - (b_1 \cdot a_2)\, b_1},\quad b_3 = b_1 \times b_2$$

    Source: Zhou et al. 2019, eq. 15.  Differs: rows instead of columns, as stored by EDGE,
    TCDiff++ and Lodge; reading their files as columns gives the inverse rotations.

    Any six numbers will do, unless their rows are zero or parallel: what comes out then is finite,
    but no rotation. Rows within a hundredth of parallel lose digits.

    Shapes: d6 (..., 6) -> (..., 3, 3).  The gradient stays finite for every non-zero input.

    >>> d6 = torch.tensor([2.0, 0, 0, 5, 3, 0])          # not orthonormal: a network's raw output
    >>> torch.equal(rot6d_to_matrix(d6), torch.eye(3))
    True
    """
    a1, a2 = d6[..., :3], d6[..., 3:]
    unit = partial(F.normalize, dim=-1, eps=max(1e-12, torch.finfo(d6.dtype).tiny))
    b1 = unit(a1)
    b2 = unit(a2 - (b1 * a2).sum(-1, keepdim=True) * b1)
    return torch.stack([b1, b2, torch.linalg.cross(b1, b2)], dim=-2)


def axis_angle_to_matrix(v: Tensor) -> Tensor:
    r"""Rotation about ``v / |v|`` by ``|v|`` radians (Rodrigues' formula).

    $$R = I + \sin\theta\,K + (1-\cos\theta)\,K^2$$

    Shapes: v (..., 3), radians -> (..., 3, 3).

    >>> R = axis_angle_to_matrix(torch.tensor([0.0, torch.pi / 2, 0.0]))   # quarter turn about up
    >>> (R @ torch.tensor([0.0, 0.0, 1.0])).round(decimals=5).tolist()     # forward becomes left
    [1.0, 0.0, 0.0]
    """
    return roma.rotvec_to_rotmat(v)


def matrix_to_axis_angle(R: Tensor) -> Tensor:
    r"""Inverse of `axis_angle_to_matrix`, angles in [0, pi].

    Shapes: R (..., 3, 3) -> (..., 3), radians.

    >>> v = torch.tensor([0.1, -0.7, 0.4])
    >>> torch.allclose(matrix_to_axis_angle(axis_angle_to_matrix(v)), v, atol=1e-5)
    True
    """
    return roma.rotmat_to_rotvec(R)


def rotation_angle(R: Tensor) -> Tensor:
    r"""By how much a rotation turns: $\arccos((\operatorname{tr} R - 1) / 2)$, within [0, pi].

    In float32 angles under about a thousandth of a radian are lost to rounding.

    Shapes: R (..., 3, 3) -> (...), radians.

    >>> rotation_angle(rotation_about("y", torch.tensor(-1.0)))
    tensor(1.)
    """
    trace = R.diagonal(dim1=-2, dim2=-1).sum(-1)
    return ((trace - 1) / 2).clamp(-1, 1).acos()


def rotation_about(axis: str, angle: Tensor) -> Tensor:
    r"""Rotation about one coordinate axis, ``axis`` in "xyz".

    Shapes: angle (...), radians -> (..., 3, 3).
    Raises: ValueError for another axis name.

    >>> rotation_about("z", torch.tensor(0.0)).equal(torch.eye(3))
    True
    """
    if axis not in ("x", "y", "z"):
        raise ValueError(f"axis={axis!r} is not one of 'x', 'y', 'z'")
    v = torch.zeros(*angle.shape, 3, dtype=angle.dtype, device=angle.device)
    v[..., "xyz".index(axis)] = angle
    return axis_angle_to_matrix(v)


def rotation_between(a: Tensor, b: Tensor) -> Tensor:
    r"""Shortest rotation that turns direction ``a`` into direction ``b``.

    $$R = I + [a\times b]_\times + \frac{[a\times b]_\times^2}{1 + a\cdot b}$$

    Shapes: a, b (..., 3), any non-zero length -> (..., 3, 3).  Opposite directions have no shortest
    rotation; the denominator is then held at 1e-6.

    >>> a, b = torch.tensor([0.0, -2.0, 0.0]), torch.tensor([1.0, 0.0, 0.0])
    >>> torch.allclose(rotation_between(a, b) @ a, 2 * b, atol=1e-5)
    True
    """
    a = torch.nn.functional.normalize(a, dim=-1)
    b = torch.nn.functional.normalize(b, dim=-1)
    c = torch.linalg.cross(a, b)
    zero = torch.zeros_like(c[..., 0])
    x, y, z = c.unbind(-1)
    K = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))
    cos = (a * b).sum(-1)[..., None, None]
    return torch.eye(3, dtype=a.dtype, device=a.device) + K + K @ K / (1 + cos).clamp_min(1e-6)


def slerp(R0: Tensor, R1: Tensor, w: Tensor) -> Tensor:
    r"""Turn from one rotation to another along the shortest arc.

    $$R(w) = R_0 \exp(w \log(R_0^\top R_1))$$

    Source: Shoemake 1985, in matrices.  Differs: EDGE goes through quaternions and blends them
    linearly when they are close, which is the same to first order.

    Shapes: R0, R1 (..., 3, 3), w broadcasts to (...) -> (..., 3, 3).

    >>> start, stop = rotation_about("y", torch.tensor(0.0)), rotation_about("y", torch.tensor(2.0))
    >>> half = slerp(start, stop, torch.tensor(0.5))
    >>> torch.allclose(half, rotation_about("y", torch.tensor(1.0)), atol=1e-6)
    True
    """
    return R0 @ axis_angle_to_matrix(w[..., None] * matrix_to_axis_angle(R0.mT @ R1))
