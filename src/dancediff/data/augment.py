r"""Changes that leave a dance a dance: turn the stage, mirror it (`motion.mirror`), shift it.

Symbols (axes: n dancers · f frames · d motion features)
    x   motion vectors, not normalised   (..., d)
"""

import torch
from torch import Tensor

from dancediff.motion.representation import TCDIFFPP, MotionSpec
from dancediff.motion.rotation import matrix_to_rot6d, rot6d_to_matrix, rotation_about


def rotate_features(x: Tensor, angle: float, spec: MotionSpec = TCDIFFPP) -> Tensor:
    r"""Turn the whole stage about the vertical through its middle.

    $$p \mapsto R_y p,\quad R_0 \mapsto R_y R_0$$

    Contacts, heights and all other joints stay as they are.  Source: ours; the papers turn nothing.

    Shapes: x (..., d), angle in radians -> (..., d).

    >>> x = torch.zeros(1, 151)
    >>> x[:, 4:7] = torch.tensor([0.0, 0.9, 1.0])              # a metre towards the audience
    >>> rotate_features(x, torch.pi / 2)[0, 4:7].round(decimals=5).tolist()
    [1.0, 0.8999999761581421, 0.0]
    """
    turn = rotation_about("y", torch.tensor(float(angle), dtype=x.dtype))
    y = x.clone()
    y[..., spec.root] = x[..., spec.root] @ turn.T
    hips = slice(spec.rot6d.start, spec.rot6d.start + 6)
    y[..., hips] = matrix_to_rot6d(turn @ rot6d_to_matrix(x[..., hips]))
    return y


def shift_features(x: Tensor, dx: float, dz: float, spec: MotionSpec = TCDIFFPP) -> Tensor:
    """Move the whole stage in its plane, by metres; (..., d) -> (..., d).

    >>> shift_features(torch.zeros(1, 151), 2.0, -1.0)[0, 4:7].tolist()
    [2.0, 0.0, -1.0]
    """
    y = x.clone()
    y[..., spec.root] += x.new_tensor([dx, 0.0, dz])
    return y
