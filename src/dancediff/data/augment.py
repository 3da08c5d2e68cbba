r"""Changes that leave a dance a dance: mirror the stage, turn it, shift it; play another song.

Symbols (axes: n dancers · f frames · d motion features)
    x   motion vectors, not normalised   (..., d)
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import TCDIFFPP, MotionSpec
from dancediff.motion.rotation import matrix_to_rot6d, rot6d_to_matrix, rotation_about


@dataclass(frozen=True)
class Augmentation:
    """How training windows are changed at random; nothing by default.

    mirror    share of windows mirrored left to right
    rotate    largest turn of the stage to either side, radians
    shift     largest offset of the whole group along x and along z, metres
    music     any of the songs that fit a take's beats, not always the first
    any_song  share of real windows that have the song of any synthetic dance: songs that were made
              to fit a real dance tell its genre, so that a model would not listen to the genre

    Raises: ValueError naming the value.
    """

    mirror: float = 0.0
    rotate: float = 0.0
    shift: float = 0.0
    music: bool = False
    any_song: float = 0.0

    def __post_init__(self):
        check_share("mirror", self.mirror)
        check_share("any_song", self.any_song)
        if not 0 <= self.rotate <= np.pi:
            raise ValueError(f"rotate={self.rotate} is no angle; choose 0 to pi radians")
        if not 0 <= self.shift < float("inf"):
            raise ValueError(f"shift={self.shift} is no length; choose metres, 0 or more")

    def motion(self, x: Tensor, rng: np.random.Generator, spec: MotionSpec = TCDIFFPP) -> Tensor:
        """Perhaps mirror, turn and shift a window (..., f, d); never changes ``x``."""
        if self.mirror and rng.random() < self.mirror:
            x = mirror_features(x, spec)
        if self.rotate:
            x = rotate_features(x, rng.uniform(-self.rotate, self.rotate), spec)
        if self.shift:
            dx, dz = rng.uniform(-self.shift, self.shift, 2)
            x = shift_features(x, dx, dz, spec)
        return x


def check_share(name: str, value: float) -> None:
    """Refuse what is no share of windows.

    Raises: ValueError naming the argument and its value.
    """
    if not 0 <= value <= 1:
        raise ValueError(f"{name}={value} is no share; choose 0 (never) to 1 (always)")


def rotate_features(x: Tensor, angle: float, spec: MotionSpec = TCDIFFPP) -> Tensor:
    r"""Turn the whole stage about the vertical through its middle.

    $$p \mapsto R_y p,\quad R_0 \mapsto R_y R_0$$

    Contacts, heights and all other joints stay as they are.

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
