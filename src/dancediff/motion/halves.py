r"""A body in two halves and a root that moves: what motion units are units of.

Symbols (axes: any axes in front · f frames)
    x       motion, normalised                                       (..., f, 151)
    upper   rotations of 15 joints                                   (..., f, 90)
    lower   contacts and rotations of pelvis, legs and feet          (..., f, 58)
    root    velocity over the floor (x, z), a second, and height     (..., f, 3)
"""

import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.motion.representation import TCDIFFPP

LEGS = (0, 1, 2, 4, 5, 7, 8, 10, 11)  # pelvis, hips, knees, ankles, toes
LOWER = [*range(TCDIFFPP.contact.stop), *TCDIFFPP.joint_channels(LEGS)]
UPPER = TCDIFFPP.joint_channels(j for j in range(TCDIFFPP.num_joints) if j not in LEGS)


def split(x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Upper half, lower half and root.

    >>> [part.shape[-1] for part in split(torch.zeros(2, 8, 151))]
    [90, 58, 3]
    """
    steps = x[..., TCDIFFPP.floor].diff(dim=-2)
    steps = torch.cat([steps[..., :1, :], steps], dim=-2)  # the first frame: like the second
    height = x[..., TCDIFFPP.height].unsqueeze(-1)
    return x[..., UPPER], x[..., LOWER], torch.cat([FPS * steps, height], dim=-1)


def assemble(upper: Tensor, lower: Tensor, root: Tensor, start: Tensor) -> Tensor:
    """The whole body, one step on from ``start`` (..., 2) in the first frame.

    Source: Bailando adds up velocities, too.  Differs: the height is a height, which
    cannot drift.

    >>> x = torch.randn(1, 8, 151)
    >>> again = assemble(*split(x[:, 1:]), start=2 * x[:, 1, 4::2][:, :2] - x[:, 2, 4::2][:, :2])
    >>> torch.allclose(again, x[:, 1:], atol=1e-5)
    True
    """
    x = upper.new_zeros(*upper.shape[:-1], TCDIFFPP.dim)
    x[..., UPPER], x[..., LOWER] = upper, lower
    x[..., TCDIFFPP.floor] = start.unsqueeze(-2) + root[..., :2].cumsum(-2) / FPS
    x[..., TCDIFFPP.height] = root[..., 2]
    return x
