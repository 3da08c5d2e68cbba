r"""Where the floor is."""

from torch import Tensor

from dancediff.motion.skeleton import FOOT_JOINTS

TOE_CLEARANCE = 0.02  # metres: height of the toe joint of a foot that stands flat


def ground_height(joints: Tensor, *, quantile: float = 0.05) -> Tensor:
    r"""Height of the floor under a dance, from its lowest toes.

    A low quantile rather than the minimum, so that one bad frame does not lift the whole dance.

    Shapes: joints (..., f, j, 3) metres -> (...) metres.

    >>> import torch
    >>> round(ground_height(torch.full((10, 24, 3), 0.32)).item(), 3)
    0.3
    """
    toes = joints[..., FOOT_JOINTS[2:], 1].flatten(-2)
    return toes.quantile(quantile, dim=-1) - TOE_CLEARANCE
