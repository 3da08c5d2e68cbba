"""Smooth primitives: each keeps its pose, velocity and acceleration, and loses its jitter.

Symbols (axes: d motion features)
    x      primitives, metres and 6-D rotations    (..., 8, d)
    tau    time within a primitive, -1 ... 1       (8,)
"""

import torch
from torch import Tensor

from dancediff.motion.representation import LODGE
from dancediff.motion.rotation import matrix_to_rot6d, rot6d_to_matrix


def smooth_primitives(x: Tensor) -> Tensor:
    r"""The parabola through the rotations of each primitive, by least squares; the rest stays.

    $$x_k \leftarrow a + b\,\tau_k + c\,\tau_k^2$$

    A primitive tells a pose, a velocity and whether that changes. What eight frames of a network
    say beyond it is jitter, and local diffusion would have to repeat it at every seam.

    Shapes: x (..., 8, d) -> (..., 8, d), rotations orthonormal again.

    >>> x = torch.randn(3, 8, 139)
    >>> twice = smooth_primitives(smooth_primitives(x))
    >>> twice.shape, torch.equal(twice[..., :7], x[..., :7])
    (torch.Size([3, 8, 139]), True)
    """
    tau = torch.linspace(-1, 1, x.shape[-2], dtype=torch.float64)
    powers = torch.stack([tau**0, tau, tau**2], dim=-1)
    fit = (powers @ torch.linalg.pinv(powers)).to(x)
    smooth = fit @ x[..., LODGE.rot6d]
    y = x.clone()
    y[..., LODGE.rot6d] = matrix_to_rot6d(rot6d_to_matrix(smooth.unflatten(-1, (-1, 6)))).flatten(
        -2
    )
    return y
