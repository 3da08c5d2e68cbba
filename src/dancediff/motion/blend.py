r"""Cross-fades between two versions of the same frames.

Symbols (axes: o frames that two versions share · d motion features)
    w   share of the second version, from 0 to 1   (o,)
"""

import torch
from torch import Tensor

from dancediff.motion.representation import pack, unpack
from dancediff.motion.rotation import slerp


def cross_fade(first: Tensor, second: Tensor) -> Tensor:
    r"""From one version of some frames to another: rotations by `slerp`, the rest in a line.

    $$p_i = (1 - w_i)\,p^0_i + w_i\,p^1_i, \quad R_i = \text{slerp}(R^0_i, R^1_i, w_i), \quad
      w_i = i / (o - 1)$$

    Source: EDGE's code.  Differs: the weights and contacts of an overlap of one frame are halves.

    Shapes: first, second (..., o, d), metres and 6-D rotations -> (..., o, d).
    """
    o = first.shape[-2]
    w = torch.linspace(0, 1, o) if o > 1 else torch.full((1,), 0.5)
    w = w.to(first)
    contact_0, root_0, pose_0 = unpack(first)
    contact_1, root_1, pose_1 = unpack(second)
    return pack(
        torch.lerp(contact_0, contact_1, w[:, None]),
        torch.lerp(root_0, root_1, w[:, None]),
        slerp(pose_0, pose_1, w[:, None]),
    )
