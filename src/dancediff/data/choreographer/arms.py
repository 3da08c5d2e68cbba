r"""Arms: from named poses on the beats to joint rotations that never enter the body.

Read first: `dancediff.data.choreographer.poses`.

Symbols (axes: n dancers · f frames · s sides (left, right) · k keys)
    q     collar, shoulder, elbow and wrist rotations    (..., 4, 4) quaternions
    hand  position in the chest's frame, metres          (n, f, 3)
"""

from itertools import pairwise

import numpy as np

from dancediff.data.choreographer.footsteps import OFFSETS, smoothstep
from dancediff.data.choreographer.moves import Style
from dancediff.data.choreographer.poses import ARM_JOINTS, pose_between, pose_key
from dancediff.data.choreographer.quaternion import euler, to_matrix
from dancediff.data.choreographer.score import Count
from dancediff.data.choreographer.tracks import pose_track, same_hemisphere, smoothed

_REST = "low"  # smaller arms are nearer to this
_NARROW = "bent"  # and those of dancers who pass each other to this
_PASSING = (0.65, 1.5)  # metres between two dancers: arms at the body, arms free
_FLAT = np.array([0.80, 1.0, 1.0])  # a torso is wider than it is deep: x counts less
_TOP, _CROWN, _CHIN = np.array([[0.0, 0.06, -0.02], [0.0, 0.40, 0.03], [0.0, 0.26, 0.01]])
_TORSO, _HEAD, _THIGH, _HANDS = 0.165, 0.165, 0.125, 0.10  # metres a hand keeps away
_ROUNDS = 2


def arm_keys(counts: list[Count], side: int):
    """Pose keys of one arm: beats (k,), names, whether they are only passed through, sizes.

    ``side`` +1 left, -1 right; a flipped move gives its left arm to the right side.
    """
    keys = []
    for k, count in enumerate(counts):
        left, right = (count.arms or count.move).arms
        mine = left if (side > 0) != count.flip else right
        keys += [
            (k + at - count.within, name, through, count.size)
            for at, name, through in mine
            if int(at) == count.within
        ]
    if not keys or keys[0][0] > 0:
        keys.insert(0, (-0.01, keys[0][1] if keys else _REST, False, 1.0))
    keys.append((len(counts) + 1.0, keys[-1][1], False, keys[-1][3]))
    time, names, through, size = zip(*keys, strict=True)
    return np.array(time), names, np.array(through), np.array(size)


def elbow_room(floor: np.ndarray) -> np.ndarray:
    """How freely each dancer can move the arms: 0 beside another dancer, 1 away from all.

    Shapes: floor (n, f, 2) metres -> (n, f).

    >>> elbow_room(np.array([[[0.0, 0.0]], [[0.5, 0.0]], [[2.0, 0.0]]])).ravel().tolist()
    [0.0, 0.0, 1.0]
    """
    gap = floor[:, None] - floor[None]
    near = np.sqrt((gap * gap).sum(-1)) + np.where(np.eye(len(floor)), np.inf, 0)[..., None]
    low, high = _PASSING
    return smoothstep((near.min(1) - low) / (high - low))


def arm_track(
    counts: list[Count], side: int, beat: np.ndarray, style: Style, room: np.ndarray
) -> np.ndarray:
    """Joint rotations of one arm in every frame, (f, 4, 4) quaternions; room (f,) 0..1."""
    time, names, through, size = arm_keys(counts, side)
    rest = pose_key(_REST, side)
    keys = np.stack([pose_key(name, side) for name in names])
    between = np.stack([pose_between(a, b, side) for a, b in pairwise(names)])
    keys = mixed(keys, rest, size)
    between = mixed(between, rest, (size[1:] + size[:-1]) / 2)
    q = pose_track(time, keys, between, through, beat, style)
    q = same_hemisphere(q)
    q = mixed(q / np.linalg.norm(q, axis=-1, keepdims=True), pose_key(_NARROW, side), room)
    return smoothed(same_hemisphere(q), style.smooth, 0)


def mixed(q: np.ndarray, rest: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Rotations between ``rest`` (share 0) and ``q`` (share 1), (..., 4, 4); share (k,)."""
    share = share.reshape(-1, 1, 1)
    near = q * np.where((q * rest).sum(-1, keepdims=True) < 0, -1.0, 1.0)
    out = share * near + (1 - share) * rest
    return out / np.linalg.norm(out, axis=-1, keepdims=True)


def arm_matrices(q: np.ndarray, shrug: np.ndarray, body: np.ndarray) -> np.ndarray:
    """Local rotations, hands kept out of the body and apart.

    ``body`` are pelvis, both hips and both knees in the chest's frame.

    Shapes: q (n, 2, f, 4, 4), shrug (n, f) degrees, body (n, f, 5, 3) -> (n, 2, f, 4, 3, 3).
    """
    R = to_matrix(q)
    lift = np.radians(shrug)
    for s, sign in ((0, 1.0), (1, -1.0)):
        R[:, s, :, 0] = euler(0.0, -sign * lift, 0.0) @ R[:, s, :, 0]
    shoulder = [
        OFFSETS[c] + R[:, s, :, 0] @ OFFSETS[a] for s, (c, a, _, _) in enumerate(ARM_JOINTS)
    ]
    for _ in range(_ROUNDS):
        elbows, hands = zip(*(_reach(R[:, s], shoulder[s], s) for s in (0, 1)), strict=True)
        nearest, apart = _apart(elbows, hands)
        for s, sign in ((0, 1.0), (1, -1.0)):
            turn = _lever(hands[s] - shoulder[s], _out_of_body(hands[s], body))
            turn = turn + _lever(nearest[s] - shoulder[s], sign * apart)
            collar = R[:, s, :, 0]
            fix = np.swapaxes(collar, -1, -2) @ _rodrigues(turn) @ collar
            R[:, s, :, 1] = fix @ R[:, s, :, 1]
    return R


def _lever(arm: np.ndarray, push: np.ndarray) -> np.ndarray:
    """The small turn about the shoulder that moves a point of the arm by ``push``."""
    return np.cross(arm, push) / np.maximum((arm * arm).sum(-1, keepdims=True), 0.02)


def _reach(R: np.ndarray, shoulder: np.ndarray, s: int) -> tuple[np.ndarray, np.ndarray]:
    """Elbow and hand in the chest's frame, (n, f, 3); R (n, f, 4, 3, 3) of one arm."""
    _, _, elbow, wrist = ARM_JOINTS[s]
    C, S, E, W = np.moveaxis(R, -3, 0)
    fore = OFFSETS[wrist] + W @ OFFSETS[wrist + 2]
    upper = C @ S
    at = shoulder + upper @ OFFSETS[elbow]
    return at, at + (upper @ (E @ fore[..., None]))[..., 0]


def _out_of_body(hand: np.ndarray, body: np.ndarray) -> np.ndarray:
    """The way a hand must move to be clear of torso, head and thighs, (n, f, 3)."""
    pelvis, hips, knees = body[:, :, 0], body[:, :, 1:3], body[:, :, 3:5]
    push = _push(hand, _TOP, pelvis, _TORSO) + _push(hand, _CROWN, _CHIN, _HEAD)
    return push + sum(_push(hand, hips[:, :, s], knees[:, :, s], _THIGH) for s in (0, 1))


def _apart(elbows, hands):
    """Nearest points of both forearms, and what to add to the left one, and take from the right.

    Crossing forearms pass above each other: the left one is the upper.
    """
    (p, r), (a, b) = elbows, (hands[0] - elbows[0], hands[1] - elbows[1])
    aa, bb, ab = (_dot(x, y) for x, y in ((a, a), (b, b), (a, b)))
    gap = p - r
    u = np.clip((ab * _dot(b, gap) - bb * _dot(a, gap)) / np.maximum(aa * bb - ab * ab, 1e-6), 0, 1)
    v = np.clip((ab * u + _dot(b, gap)) / bb, 0, 1)
    u = np.clip((ab * v - _dot(a, gap)) / aa, 0, 1)
    left, right = p + u * a, r + v * b
    gap = left - right
    wide = np.sqrt(_dot(gap, gap))
    away = gap + np.array([0.0, 0.05, 0.03])
    away = away / np.sqrt(_dot(away, away) + 1e-9)
    return (left, right), 0.5 * np.maximum(_HANDS - wide, 0) * away


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(-1, keepdims=True)


def _push(p, top, bottom, radius: float) -> np.ndarray:
    """The shortest way out of a capsule, 0 outside; p, top, bottom (..., 3) -> (..., 3)."""
    axis = bottom - top
    u = np.clip(((p - top) * axis).sum(-1) / (axis * axis).sum(-1), 0, 1)
    away = (p - top - u[..., None] * axis) * _FLAT
    gap = np.sqrt((away * away).sum(-1, keepdims=True))
    return away / np.maximum(gap, 1e-3) * np.maximum(radius - gap, 0)


def _rodrigues(v: np.ndarray) -> np.ndarray:
    half = 0.5 * np.clip(v, -1, 1)
    return to_matrix(np.concatenate([np.ones((*v.shape[:-1], 1)), half], -1))
