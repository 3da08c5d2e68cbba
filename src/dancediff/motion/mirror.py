r"""Mirror a dance left to right (mirror plane x = 0).

Read first: notebook 01.
"""

import torch
from torch import Tensor

from dancediff.motion.representation import TCDIFFPP, MotionSpec

_PAIRS = ((1, 2), (4, 5), (7, 8), (10, 11), (13, 14), (16, 17), (18, 19), (20, 21), (22, 23))
_FLIP6 = (1.0, -1.0, -1.0, -1.0, 1.0, 1.0)  # a row-6D rotation conjugated by diag(-1, 1, 1)


def mirror_features(x: Tensor, spec: MotionSpec = TCDIFFPP) -> Tensor:
    r"""Mirror motion vectors: swap left and right joints, negate x.

    $$R_j \mapsto D R_{\bar j} D,\quad D = \operatorname{diag}(-1, 1, 1),\quad x \mapsto -x$$

    Source: the mirror augmentation of FineDance and Lodge.  Differs: Lodge mirrors normalised
    values, which is only right when the ranges are symmetric; this takes metres.

    Exact on a symmetric skeleton; SMPL-24 is symmetric to about 2 cm, so feet move by that much.

    Shapes: x (..., d) not normalised -> (..., d).
    Raises: ValueError for another d than that of ``spec``.

    >>> x = torch.randn(5, 151)
    >>> torch.equal(mirror_features(mirror_features(x)), x)
    True
    >>> from dancediff.motion.representation import LODGE
    >>> mirror_features(torch.randn(5, 139), LODGE).shape                  # without the hands
    torch.Size([5, 139])
    """
    spec.check(x)
    swap = list(range(spec.num_joints))
    for a, b in _PAIRS:
        if b < spec.num_joints:
            swap[a], swap[b] = b, a
    contact = x[..., spec.contact][..., [1, 0, 3, 2]]
    root = x[..., spec.root] * x.new_tensor([-1.0, 1.0, 1.0])
    rot6d = x[..., spec.rot6d].unflatten(-1, (spec.num_joints, 6))[..., swap, :]
    return torch.cat([contact, root, (rot6d * x.new_tensor(_FLIP6)).flatten(-2)], dim=-1)
