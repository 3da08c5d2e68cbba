r"""What every metric of a clip checks before it computes.

Symbols (axes: n dancers · f frames · j joints)
    joints  positions, metres, y up      (n, f, j, 3), or (f, j, 3) for one dancer
"""

import torch
from torch import Tensor

BODY_JOINTS = (22, 24)  # SMPL with and without the two hand joints
ACCELERATION = 3  # frames that an acceleration needs


def as_group(joints: Tensor, fps: float, *, least: int, dancers: int = 1) -> Tensor:
    """The joints as float64 (n, f, j, 3), when they are fit for a metric.

    ``least`` is the smallest number of frames, ``dancers`` of dancers, that the metric needs.

    Shapes: joints (n, f, j, 3) or (f, j, 3), j = 22 or 24, metres -> (n, f, j, 3) float64.
    Raises: ValueError naming what does not fit: type, shape, length, dancers, NaN, frame rate.

    >>> as_group(torch.zeros(9, 24, 3), 30.0, least=2).shape
    torch.Size([1, 9, 24, 3])
    """
    joints = _tensor(joints).detach().to("cpu", torch.float64)
    shape = tuple(joints.shape)
    if joints.ndim not in (3, 4) or shape[-2] not in BODY_JOINTS or shape[-1] != 3:
        raise ValueError(f"joints has shape {shape}; expected (n, f, 24, 3) or (f, 24, 3)")
    joints = joints if joints.ndim == 4 else joints[None]
    n, f = joints.shape[:2]
    if n < dancers:
        raise ValueError(f"joints has {n} dancers; this metric needs {dancers} or more")
    if f < least:
        raise ValueError(f"joints has {f} frames; this metric needs {least} or more")
    if not joints.isfinite().all():
        raise ValueError("joints has NaN or infinite values; repair or cut the motion first")
    if not 0 < fps < float("inf"):
        raise ValueError(f"fps={fps} must be positive")
    return joints


def as_dancers(joints: Tensor, fps: float, *, least: int) -> tuple[Tensor, torch.Size]:
    """As `as_group` with any axes in front, and these axes, to put them back.

    Shapes: joints (..., f, j, 3) -> (n, f, j, 3) float64, size of (...).
    """
    joints = _tensor(joints)
    many = joints.flatten(0, -4) if joints.ndim > 4 else joints
    return as_group(many, fps, least=least), joints.shape[:-3]


def _tensor(joints) -> Tensor:
    """Joints as a tensor, wherever they come from; a dance itself is named as what it is."""
    try:
        return torch.as_tensor(joints)
    except (TypeError, RuntimeError) as err:
        raise ValueError(
            f"joints is a {type(joints).__name__}; give positions (n, f, 24, 3), of a Motion those "
            "of motion.joints()"
        ) from err


def check_compat(compat: str | None, known: tuple[str, ...], metric: str) -> None:
    """Refuse a published variant that is not described for a metric.

    Raises: ValueError listing the variants that exist.

    >>> check_compat(None, ("edge",), "PFC")
    """
    if compat is not None and compat not in known:
        exist = ", ".join(map(repr, known))
        raise ValueError(f"compat={compat!r} is unknown for {metric}; use None or {exist}")
