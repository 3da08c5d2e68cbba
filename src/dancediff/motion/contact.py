r"""Which feet stand on the floor.

Symbols (axes: f frames · j joints)
    joints   positions, metres                (..., f, j, 3)
    contact  0 or 1 per foot joint            (..., f, 4)   left and right ankle, left and right toe
"""

import torch
from torch import Tensor

from dancediff.axes import FPS, ON_FLOOR
from dancediff.lookup import table
from dancediff.motion.skeleton import feet_of

CONTACT_HEIGHT = (0.12, 0.12, 0.05, 0.05)  # metres above the floor: ankles, toes
TOE_CLEARANCE = 0.02  # metres: height of the toe joint of a foot that stands flat
CONTACT_SPEED = 0.01  # metres a frame at 30 fps, in the floor plane


def feet_low(joints: Tensor) -> Tensor:
    """Which foot joints are under their contact height, whatever their speed.

    Shapes: joints (..., f, j, 3) metres -> bool (..., f, 4).

    >>> feet_low(torch.zeros(2, 24, 3)).all().item()
    True
    """
    height = feet_of(joints)[..., 1]
    return height < table(torch.tensor, CONTACT_HEIGHT, like=height)


def foot_speed(joints: Tensor) -> Tensor:
    """How far each foot joint moves in the floor plane until the next frame.

    Shapes: joints (..., f, j, 3) metres -> (..., f, 4) metres a frame; the last frame repeats the
    one before it (0 if there is only one frame).

    >>> foot_speed(torch.zeros(5, 24, 3)).shape
    torch.Size([5, 4])
    """
    feet = feet_of(joints)[..., ON_FLOOR]
    if feet.shape[-3] == 1:
        return torch.zeros_like(feet[..., 0])
    speed = feet.diff(dim=-3).norm(dim=-1)
    return torch.cat([speed, speed[..., -1:, :]], dim=-2)


def foot_contact(joints: Tensor, fps: float = FPS) -> Tensor:
    r"""Label a foot joint as planted when it is low and does not travel.

    $$b = [\,y < h\,]\,\cdot\,[\,\lVert \Delta p_{xz} \rVert < 0.01 \cdot 30 / \text{fps}\,],\quad
      h = 0.12\text{ m (ankle)},\ 0.05\text{ m (toe)}$$

    Source: thresholds of Lodge's preprocessing (height) and EDGE's (speed).  Differs: EDGE uses the
    speed alone, also upwards, and calls the last frame planted always; Lodge uses the height alone,
    so that a foot that skates is called planted.

    Shapes: joints (..., f, j, 3) metres -> (..., f, 4) of 0. and 1.

    >>> foot_contact(torch.zeros(3, 24, 3)).sum().item()
    12.0
    """
    slow = foot_speed(joints) < CONTACT_SPEED * (FPS / fps)
    return (feet_low(joints) & slow).to(joints.dtype)
