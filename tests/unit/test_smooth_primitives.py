"""Smooth primitives: `dancediff.extensions.smooth_primitives`."""

import torch

from dancediff.extensions.smooth_primitives import smooth_primitives
from dancediff.motion.representation import LODGE
from dancediff.motion.rotation import matrix_to_rot6d, rot6d_to_matrix


def largest_change(x):
    return x[..., LODGE.rot6d].diff(n=2, dim=1).abs().amax(-1)[0].max()


def test_a_parabola_stays_and_unrest_goes():
    tau = torch.linspace(-1, 1, 8)[:, None]
    x = torch.zeros(2, 8, 139)
    x[..., LODGE.rot6d] = matrix_to_rot6d(torch.eye(3).expand(22, 3, 3)).flatten()
    x[..., LODGE.rot6d.start] += 0.3 * tau[:, 0] ** 2  # the first column grows, and is cut to 1
    torch.testing.assert_close(smooth_primitives(x)[..., 7], torch.ones(2, 8))
    shaken = x + 0.05 * torch.randn(x.shape, generator=torch.Generator().manual_seed(0))
    smooth = smooth_primitives(shaken)
    assert largest_change(smooth) < 0.5 * largest_change(shaken)
    R = rot6d_to_matrix(smooth[..., LODGE.rot6d].unflatten(-1, (-1, 6)))
    torch.testing.assert_close(R @ R.mT, torch.eye(3).expand(R.shape), atol=1e-5, rtol=0)
