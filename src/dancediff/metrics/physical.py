r"""PFC, FSR and depth below the floor: do feet explain the motion, stand still, stay above it?

Read first: notebook 13 · EDGE (PFC) · Lodge (FSR).

Symbols (axes: n dancers · f frames · j joints · 2 feet, left and right)
    joints  positions, metres, y up                       (n, f, j, 3) or (f, j, 3)
    a       acceleration of the root, metres a s^2        (n, f - 2)
    u       how far a foot travels in 1/30 s, metres      (n, f - 2, 2)
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from dancediff.axes import ON_FLOOR
from dancediff.metrics.inputs import as_group, check_compat
from dancediff.motion.contact import CONTACT_HEIGHT
from dancediff.motion.skeleton import FOOT_JOINTS

SLIDE_SPEED = 0.3  # metres a second: Lodge's 1 cm a frame at 30 fps
LODGE_HEIGHT = (0.08, 0.08, 0.05, 0.05)  # metres: ankles, toes
LODGE_TOES = 0.02  # metres between the toes of the first frame, up to which both say where it is
STEP = 1 / 30  # seconds in which PFC measures how far a foot travels


def pfc(joints: Tensor, *, fps: float = 30.0, compat: str | None = None) -> float:
    r"""Physical foot contact: the root speeds up while no foot pushes. Lower is better.

    $$\mathrm{PFC} = 10^4\,\frac1{f-2} \sum_i \frac{\lVert a_i\rVert}{\max_k \lVert a_k\rVert}\,
      u_i^{\text{left}}\,u_i^{\text{right}},\quad
      u^{\text{foot}} = \min(\Delta_{xz}\,\text{ankle},\ \Delta_{xz}\,\text{toe})$$

    Falling is free: a downward acceleration counts as 0. The mean over dancers is returned. A
    dancer whose root never accelerates has PFC 0 (0/0 in the formula), so a frozen dance gets the
    best score there is, and so does one that keeps a foot planted. Read it beside BAS and FID_k.

    Source: EDGE, section 5.  Differs: feet travel per 1/30 s at every frame rate; EDGE's code takes
    them per frame, so 60 fps scores a quarter, and returns NaN where the root never accelerates.
    ``compat="edge"`` does the same as that code. At 30 fps both are equal otherwise. The division
    by the clip's own maximum makes both depend on the clip's length.

    Shapes/units: joints (n, f, 24, 3) metres -> float, cm^2 per (1/30 s)^2.
    Raises: ValueError for less than 3 frames, NaN, a wrong shape, fps or compat.

    >>> pfc(torch.zeros(2, 10, 24, 3))
    0.0
    """
    check_compat(compat, ("edge",), "PFC")
    p = as_group(joints, fps, least=3)
    rate = 1.0 if compat == "edge" else fps * STEP
    a = p[:, :, 0].diff(n=2, dim=1) * fps**2
    a[..., 1].clamp_(min=0)
    a = a.norm(dim=-1)
    travel = p[:, 1:, FOOT_JOINTS][..., ON_FLOOR].diff(dim=1).norm(dim=-1) * rate
    u = torch.minimum(travel[..., :2], travel[..., 2:])  # left, right
    largest = a.amax(1, keepdim=True)
    effort = a / (largest if compat == "edge" else largest.where(largest > 0, torch.ones(())))
    return 1e4 * (effort * u.prod(-1)).mean().item()


def fsr(
    joints: Tensor,
    *,
    fps: float = 30.0,
    threshold: float = SLIDE_SPEED,
    compat: str | None = None,
) -> float:
    r"""Foot skating ratio: how much of the time on the floor a foot slides. Lower is better.

    $$\mathrm{FSR} = \frac{\sum_i [\text{low}_i]\,[\text{low}_{i+1}]\,
      [\max(v_i^{\text{ankle}}, v_i^{\text{toe}}) > \theta]}
      {\sum_i [\text{low}_i]\,[\text{low}_{i+1}]},\quad v = \lVert \Delta p_{xz}\rVert\cdot
      \text{fps}$$

    A foot is low when its ankle is under 12 cm and its toe under 5 cm, the heights of
    `foot_contact`. The sums run over both feet, all dancers and all pairs of frames.

    Source: Lodge, section 4.2.  Differs: there it is the share of frames in which either foot,
    under 5 cm, skids. Lodge's code counts feet as we do, but takes another floor, namely the toes
    of each dancer's first frame (the lower one if they differ by 2 cm); other heights (8 and 5 cm,
    which just misses or just catches a foot that stands flat); the mean of the signed x and z steps
    instead of their length, so that a foot sliding along x = -z never skates; the height in one
    frame only, the last one too; and the mean of the feet's own ratios. ``compat="lodge"`` does
    that, with a threshold in metres a second too.

    Shapes/units: joints (n, f, 24, 3) metres, threshold metres a second -> float in [0, 1].
    Raises: ValueError for less than 2 frames, no foot on the floor (in the lodge form: for a
    foot of a dancer), NaN, a wrong shape, fps, threshold or compat.

    >>> fsr(torch.zeros(10, 24, 3))
    0.0
    """
    check_compat(compat, ("lodge",), "FSR")
    if not threshold > 0:
        raise ValueError(f"threshold={threshold} must be positive, in metres a second")
    feet = as_group(joints, fps, least=2)[:, :, FOOT_JOINTS]
    step = feet[..., ON_FLOOR].diff(dim=1) * fps
    if compat == "lodge":
        toes = feet[:, 0, 2:, 1]  # (n, 2)
        level = toes.diff(dim=-1).abs()[:, 0] < LODGE_TOES
        floor = torch.where(level, toes.mean(-1), toes.amin(-1))
        height = feet[..., 1] - floor[:, None, None]
        low = _both(height <= height.new_tensor(LODGE_HEIGHT), torch.logical_and)
        speed = F.pad(step.mean(-1).abs(), (0, 0, 0, 1))  # nothing slides in the last frame
    else:
        low = _both(feet[..., 1] < feet.new_tensor(CONTACT_HEIGHT), torch.logical_and)
        low = low[:, 1:] & low[:, :-1]
        speed = step.norm(dim=-1)
    slides = _both(speed > threshold, torch.logical_or) & low
    axes = (1,) if compat == "lodge" else (0, 1, 2)
    down = low.sum(axes)
    if not (down > 0).all():
        raise ValueError(
            "joints: a foot that FSR needs is never on the floor (y = 0); "
            "put the dance on the floor first"
        )
    return (slides.sum(axes) / down).double().mean().item()


def below_floor(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""Depth below the floor: how far the lowest joint is under it, on average. Lower is better.

    $$\mathrm{below} = 100 \cdot \frac1{n f} \sum_{k,i} \max(0,\, -\min_j y_{k,i,j})$$

    It sees dancers who sink, whom metrics of differences of frames do not see; one who flies has 0.
    A joint is the middle of a limb, so a foot is a few centimetres deeper than its joints.

    Source: ours.  Shapes/units: joints (n, f, 24, 3) metres, floor y = 0 -> float, cm.
    Raises: ValueError for NaN, a wrong shape or fps.

    >>> below_floor(torch.zeros(2, 10, 24, 3)), below_floor(torch.full((10, 24, 3), -0.5))
    (0.0, 50.0)
    """
    lowest = as_group(joints, fps, least=1)[..., 1].amin(-1)
    return 100 * (-lowest).clamp(min=0).double().mean().item()


def _both(ankle_and_toe: Tensor, how) -> Tensor:
    """Join the ankles' and the toes' answers, (..., 4) -> (..., 2) for left and right."""
    return how(ankle_and_toe[..., :2], ankle_and_toe[..., 2:])
