r"""How fast and how jerkily each joint of a dancer moves: the features of FID_k and Div_k.

Read first: notebook 13 · Lodge, section 4 · AIST++.

Symbols (axes: n dancers · f frames · j joints)
    joints  positions, metres, y up                (..., f, j, 3)
    w       half width of the window that velocities are averaged over, frames
    E       horizontal energy, vertical energy, expenditure of every joint   (n, f - 1, j, 3)
"""

import torch
from torch import Tensor

from dancediff.metrics.group import frame_energies
from dancediff.metrics.inputs import ACCELERATION, as_dancers, check_compat

WINDOW = 2
PUBLISHED_DT = {"lodge": 1 / 60, "aist": 1 / 60, "gcd": 1 / 30}


def kinetic_features(joints: Tensor, *, fps: float = 30.0, compat: str | None = None) -> Tensor:
    r"""One vector for each dancer: three numbers for every joint.

    $$\big(\overline{v_x^2 + v_z^2},\; \overline{v_y^2},\; \overline{\lVert a\rVert}\big)_j$$

    the mean over frames 1 to f - 1 of the energies of `frame_energies`, w = 2, dt = 1 / fps. Only
    differences of positions enter, so it does not matter where on the stage a dancer stands.

    Source: Onuma et al. 2008, as AIST++ brought them to dance.  Differs: the published codes
    subtract p / dt where p is meant from the acceleration, see `published_expenditure`, so that it
    grows with the distance from the origin, and fix dt. ``compat="aist"``: that, dt = 1/60 s
    whatever ``fps`` says, joints as given. ``compat="gcd"``: the same with dt = 1/30 s.
    ``compat="lodge"``: dt = 1/60 s, the root relative to its first frame, all other joints
    relative to the root of their own frame. Lodge passes 22 joints and the first 1024 frames.

    Shapes/units: joints (..., f, j, 3) metres, j = 24 or 22 -> (..., 3 j), m^2/s^2 and m/s^2.
    Raises: ValueError for less than 3 frames, NaN, a wrong shape, fps or compat.

    >>> rises = torch.arange(9.0)[:, None, None] * torch.tensor([0.0, 0.1, 0.0])  # 3 m a second
    >>> kinetic_features(rises.expand(9, 24, 3))[:3].round(decimals=3).tolist()
    [0.0, 9.0, 0.0]
    """
    check_compat(compat, tuple(PUBLISHED_DT), "kinetic features")
    p, lead = as_dancers(joints, fps, least=ACCELERATION)
    if compat == "lodge":
        p = lodge_positions(p)
    dt = PUBLISHED_DT[compat] if compat else 1 / fps
    E = frame_energies(p, window=WINDOW, dt=dt)
    if compat:
        E[..., 2] = published_expenditure(p, dt=dt)
    return E.mean(1).flatten(1).reshape(*lead, -1)


def published_expenditure(joints: Tensor, *, dt: float) -> Tensor:
    r"""Energy expenditure with the misplaced parenthesis of the published codes.

    $$\Big\lVert \tfrac1{|K|}\sum_{k\in K} \tfrac1{dt}\Big(\frac{p_{i+k+1} - p_{i+k}}{dt} -
        \big(p_{i+k} - \frac{p_{i+k-1}}{dt}\big)\Big)\Big\rVert$$

    with K as in `frame_energies`, w = 2. The earlier velocity should read
    (p_{i+k} - p_{i+k-1}) / dt. A body at rest a metre from the origin gets about 1 / dt^2.

    Shapes: joints (n, f, j, 3) metres, dt seconds -> (n, f - 1, j).

    >>> published_expenditure(torch.ones(1, 3, 1, 3) / 3**0.5, dt=0.5).round(decimals=3).flatten()
    tensor([2., 2.])
    """
    f = joints.shape[1]
    now, later, before = joints[:, 1:-1], joints[:, 2:], joints[:, :-2]
    a = ((later - now) / dt - (now - before / dt)) / dt  # a[:, i - 1] belongs to frame i
    rows = []
    for i in range(1, f):
        first, last = max(1, i - WINDOW), min(f - 2, i + WINDOW)
        rows.append(a[:, first - 1 : last].mean(1).norm(dim=-1))
    return torch.stack(rows, dim=1)


def lodge_positions(joints: Tensor) -> Tensor:
    """Positions as Lodge's evaluation takes them, for kinetic and geometric features.

    The root relative to its first frame, all others relative to the root of their own frame.

    Shapes: joints (n, f, j, 3) -> (n, f, j, 3).

    >>> lodge_positions(torch.arange(4.0).view(1, 2, 2, 1))[0, ..., 0].tolist()
    [[0.0, 1.0], [2.0, 1.0]]
    """
    root = joints[:, :, :1]
    return torch.cat([root - root[:, :1], joints[:, :, 1:] - root], dim=2)
