r"""Kinematic beats: the moments where a dancer's body comes to rest.

Symbols (axes: f frames · j joints)
    joints  positions, metres      (f, j, 3)
    speed   mean joint speed       (f,)      metres a frame
    energy  kinematic energy       (f,)      joules a kilogram
"""

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d
from torch import Tensor


def mean_speed(joints: Tensor) -> np.ndarray:
    """Mean speed of all joints in each frame, in metres a frame; (f, j, 3) -> (f,).

    Central differences, so that the curve is not half a frame early.
    Raises: ValueError for the joints of a group, (n, f, j, 3).

    >>> import torch
    >>> mean_speed(torch.zeros(4, 24, 3)).tolist()
    [0.0, 0.0, 0.0, 0.0]
    """
    x = _places(joints)
    if len(x) < 2:
        return np.zeros(len(x))
    return np.linalg.norm(np.gradient(x, axis=0), axis=-1).mean(-1)


def motion_beats(joints: Tensor, *, sigma: float = 1.5) -> np.ndarray:
    r"""Frames where the smoothed mean joint speed has a local minimum.

    $$\{\,i : \bar v_{i-1} > \bar v_i \le \bar v_{i+1}\,\},\quad
      \bar v = G_\sigma * \tfrac1J \textstyle\sum_j \lVert \dot p_j \rVert$$

    Source: the motion beats of AIST++ and Lodge.  Differs: they smooth with sigma = 5 frames, which
    merges beats above 120 BPM; 1.5 frames only removes the noise.

    Shapes: joints (f, j, 3) metres -> int frames (k,).

    >>> import torch
    >>> path = torch.cos(torch.arange(60) / 60 * 4 * torch.pi)      # turns round every 15 frames
    >>> motion_beats(path[:, None, None] * torch.ones(60, 24, 3)).tolist()
    [15, 30, 45]
    """
    v = gaussian_filter1d(mean_speed(joints), sigma, mode="nearest")
    inner = (v[:-2] > v[1:-1]) & (v[1:-1] <= v[2:])
    return np.flatnonzero(inner) + 1


def kinematic_energy(joints: Tensor, *, fps: float = 30.0, sigma: float = 0.25) -> np.ndarray:
    r"""How much the body moves around each frame, all joints of one mass.

    $$E = G_\sigma * \tfrac{1}{2J} \textstyle\sum_j \lVert \dot p_j \rVert^2$$

    At a kinematic beat the body rests; the energy around it tells a key motion that a big movement
    arrives at from one where hardly anything happens.

    Source: Lodge asks for key motions "with high kinematic energy" (section 1), without a formula.

    - ``sigma``: width of the smoothing, in seconds: half a beat's length at 120 a minute.

    Shapes: joints (f, j, 3) metres -> (f,) joules a kilogram.

    >>> import torch
    >>> walk = torch.arange(90)[:, None, None] / 30 * torch.tensor([1.0, 0, 0])  # 1 m/s
    >>> kinematic_energy(walk)[45].round(3).item()
    0.5
    """
    x = _places(joints)
    if len(x) < 2:
        return np.zeros(len(x))
    v = np.gradient(x, axis=0) * fps  # (f, j, 3) metres a second
    return gaussian_filter1d((v**2).sum(-1).mean(-1) / 2, sigma * fps, mode="nearest")


def _places(joints: Tensor) -> np.ndarray:
    """The joints of one dancer in double precision; of a group, speeds would be those between two.

    Raises: ValueError for another shape than (f, j, 3).
    """
    x = torch.as_tensor(joints).detach().double().cpu().numpy()
    if x.ndim != 3:
        raise ValueError(
            f"joints has shape {x.shape}; expected those of one dancer, (f, j, 3): joints[k]"
        )
    return x
