r"""Posture: how bodies are held while they dance, which energies, beats and feet do not show.

Read first: notebook 13 · docs/drift.md. No paper has these metrics. A dance that has settled into
one pose passes all metrics of both papers.

Every metric takes joints (n, f, 24, 3) or (f, 24, 3) in metres and raises ValueError for NaN, a
wrong shape, or too few frames. A share is in [0, 1].

Symbols (axes: n dancers · f frames · j joints)
    p       positions, metres, y up                 (n, f, j, 3)
    facing  direction of the pelvis about y, radians (n, f)
"""

import torch
from torch import Tensor

from dancediff.metrics.inputs import as_group
from dancediff.motion.skeleton import SMPL24

WIDE = 1.0  # metres between the wrists; both arms out to the sides are 1.4 m, one and a hanging 1.1
CLOSE = 0.12  # metres between the ankles; side by side below the hips they are 0.2 m
LEANS = 25.0  # degrees; the choreographer's dancers stay below 22, people dip to 56 in a duet
STILL = 0.1  # metres a second, mean of all joints
STANDS = 0.05  # metres, mean of all joints, within STAND seconds
STAND = 3.0  # seconds
HALF_A_SECOND = 0.5  # over which a turn counts: a pelvis that swings does not turn
POSE_WINDOW = 5.0  # seconds in which poses are counted
POSE_STEP = 0.1  # seconds between the poses that are compared
APART = 0.15  # metres, mean over joints, between two poses that are not the same


def arms_wide(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""Share of the frames in which the wrists are more than a metre apart.

    $$\overline{[\,\lVert p_\text{left wrist} - p_\text{right wrist} \rVert > 1\,\text{m}\,]}$$

    >>> arms_wide(_rest())                                          # a T
    1.0
    """
    return _share(_gap(as_group(joints, fps, least=1), "wrist").norm(dim=-1) > WIDE)


def knee_bend(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""How far knees are bent, degrees, mean over frames and both knees; 0 is a straight leg.

    $$\overline{\angle(p_\text{hip} - p_\text{knee},\; p_\text{knee} - p_\text{ankle})}$$

    >>> knee_bend(_rest()) < 12
    True
    """
    p = as_group(joints, fps, least=1)
    bends = []
    for side in "lr":
        hip, knee, ankle = (p[..., SMPL24.index(side + j), :] for j in ("hip", "knee", "ankle"))
        thigh, shin = hip - knee, knee - ankle
        across = torch.linalg.cross(thigh, shin).norm(dim=-1)
        bends.append(torch.atan2(across, (thigh * shin).sum(-1)))
    return torch.rad2deg(torch.stack(bends)).mean().item()


def turning(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""How fast bodies turn, degrees a second: from the pelvis now to half a second later.

    $$\overline{|\text{facing}_{i + h} - \text{facing}_i|} \cdot \text{fps} / h$$

    >>> round(turning(_rest().expand(30, -1, -1)), 3)
    0.0
    """
    lag = max(1, round(HALF_A_SECOND * fps))
    angle = facing(as_group(joints, fps, least=lag + 1))
    turn = angle[:, lag:] - angle[:, :-lag]
    turn = torch.atan2(turn.sin(), turn.cos())
    return torch.rad2deg(turn.abs().mean()).item() * fps / lag


def leaning(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""Share of the frames in which a body leans over by more than 25 degrees, as if it fell.

    $$\overline{[\,\angle(p_\text{head} - p_\text{feet},\; y) > 25^\circ\,]}, \quad
      p_\text{feet} = \tfrac12 (p_\text{left ankle} + p_\text{right ankle})$$

    A bow, with the hips behind the feet, does not lean much; a body tipped over as a whole does.

    >>> leaning(_rest())
    0.0
    """
    p = as_group(joints, fps, least=1)
    feet = (p[..., SMPL24.index("lankle"), :] + p[..., SMPL24.index("rankle"), :]) / 2
    up = p[..., SMPL24.index("head"), :] - feet
    angle = torch.atan2(up[..., ::2].norm(dim=-1), up[..., 1])  # beside the feet, above them
    return _share(torch.rad2deg(angle) > LEANS)


def ankles_close(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""Share of the frames in which the ankles are nearer than 12 cm: legs closed or crossed.

    $$\overline{[\,\lVert p_\text{left ankle} - p_\text{right ankle} \rVert < 12\,\text{cm}\,]}$$

    >>> ankles_close(_rest())
    0.0
    """
    return _share(_gap(as_group(joints, fps, least=1), "ankle").norm(dim=-1) < CLOSE)


def legs_crossed(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""Share of the frames in which the left ankle is to the right of the right one.

    $$\overline{[\,(p_\text{left ankle} - p_\text{right ankle}) \cdot
      (p_\text{left hip} - p_\text{right hip}) < 0\,]}$$

    >>> legs_crossed(_rest())
    0.0
    """
    p = as_group(joints, fps, least=1)
    return _share((_gap(p, "ankle") * _gap(p, "hip")).sum(-1) < 0)


def legs_tangled(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""Share of the frames in which the legs are crossed or the ankles nearer than 12 cm.

    The frames of `legs_crossed` and those of `ankles_close` together.

    >>> legs_tangled(_rest())
    0.0
    """
    p = as_group(joints, fps, least=1)
    ankles = _gap(p, "ankle")
    return _share((ankles.norm(dim=-1) < CLOSE) | ((ankles * _gap(p, "hip")).sum(-1) < 0))


def ankle_distance(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""How far the ankles are apart, metres, mean over frames.

    $$\overline{\lVert p_\text{left ankle} - p_\text{right ankle} \rVert}$$

    >>> 0.15 < ankle_distance(_rest()) < 0.3
    True
    """
    return _gap(as_group(joints, fps, least=1), "ankle").norm(dim=-1).mean().item()


def standing(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""Share of dancers who move less than 5 cm in three seconds.

    $$\overline{\big[\,\max_{i < 3\,\text{s}}
      \tfrac1J \textstyle\sum_j \lVert p_{s+i,j} - p_{s,j} \rVert < 5\,\text{cm}\,\big]}$$

    over dancers and stretches of 3 s, one beginning every half second at s. `stillness` finds slow
    frames, such as those between two moves; this finds who has stopped.

    Raises: ValueError also for less than 3 s.

    >>> standing(_rest().expand(90, -1, -1))
    1.0
    """
    size = round(STAND * fps)
    p = as_group(joints, fps, least=size)
    stretches = p.unfold(1, size, max(1, round(HALF_A_SECOND * fps)))  # (n, w, j, 3, size)
    # some at a time: the stretches of hours are gigabytes
    away = [(x - x[..., :1]).norm(dim=3).mean(2).amax(-1) for x in stretches.split(64, dim=1)]
    return _share(torch.cat(away, dim=1) < STANDS)


def stillness(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""Share of the frames in which a dancer hardly moves: all joints below 0.1 m/s in the mean.

    >>> stillness(_rest().expand(9, -1, -1))
    1.0
    """
    p = as_group(joints, fps, least=2)
    return _share(p.diff(dim=1).norm(dim=-1).mean(-1) * fps < STILL)


def distinct_poses(joints: Tensor, *, fps: float = 30.0) -> float:
    r"""How many poses a dancer shows in five seconds that are not the same.

    Ten poses a second are compared as seen from the pelvis, wherever it stands and faces. A pose
    counts if its joints are 15 cm in the mean away from those of every pose that counted before.

    The mean over dancers and windows of 5 s; a rest shorter than a window is ignored, a dance
    shorter than one is a window. It is the greedy cover of a set by balls of one radius.

    >>> distinct_poses(_rest().expand(300, -1, -1))
    1.0
    """
    p = as_group(joints, fps, least=1)
    size = min(round(POSE_WINDOW * fps), p.shape[1])
    windows = from_pelvis(p).unfold(1, size, size).flatten(0, 1).movedim(-1, 1)  # (w, f, j, 3)
    windows = windows[:, :: max(1, round(POSE_STEP * fps))]
    counts = torch.zeros(windows.shape[:2], dtype=torch.bool)
    for i, pose in enumerate(windows.unbind(1)):
        far = (windows[:, :i] - pose[:, None]).norm(dim=-1).mean(-1) > APART
        counts[:, i] = (far | ~counts[:, :i]).all(1)
    return counts.double().sum(1).mean().item()


def facing(joints: Tensor) -> Tensor:
    """Where the pelvis faces, about y: 0 towards +z, growing towards +x.

    Shapes: joints (..., j, 3) -> (...) radians.

    >>> facing(_rest()[0]).abs().item() < 0.1
    True
    """
    left = _gap(joints, "hip")
    return torch.atan2(-left[..., 2], left[..., 0])


def from_pelvis(joints: Tensor) -> Tensor:
    """Joints seen from the pelvis, which faces +z; (..., j, 3) -> (..., j, 3)."""
    angle = facing(joints)[..., None]
    x, y, z = (joints - joints[..., :1, :]).unbind(-1)
    return torch.stack(
        [x * angle.cos() - z * angle.sin(), y, x * angle.sin() + z * angle.cos()], -1
    )


def _share(frames: Tensor) -> float:
    return frames.double().mean().item()


def _gap(joints: Tensor, part: str) -> Tensor:
    """From the right one to the left one, (..., 3)."""
    return joints[..., SMPL24.index("l" + part), :] - joints[..., SMPL24.index("r" + part), :]


def _rest() -> Tensor:
    """One frame of the body at rest, arms out, (1, 24, 3): for the examples."""
    from dancediff.motion.skeleton import forward_kinematics

    return forward_kinematics(torch.eye(3).expand(1, 24, 3, 3), torch.zeros(1, 3))


POSTURE = {  # name of the metric: the function, its unit
    "arms wide": (arms_wide, "share"),
    "knee bend": (knee_bend, "degrees"),
    "turning": (turning, "degrees/s"),
    "leaning": (leaning, "share"),
    "ankles close": (ankles_close, "share"),
    "legs crossed": (legs_crossed, "share"),
    "legs tangled": (legs_tangled, "share"),
    "ankle distance": (ankle_distance, "m"),
    "stillness": (stillness, "share"),
    "standing": (standing, "share"),
    "distinct poses": (distinct_poses, "in 5 s"),
}
