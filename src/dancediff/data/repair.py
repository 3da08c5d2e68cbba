r"""Find and repair what no body did: spikes, flipped joints, marker swaps.

Read first: `dancediff.motion.skeleton`.

Motion capture goes wrong in three ways. A joint is turned by half a turn about one of its own axes
for a while (its markers were swapped): it is turned back. It moves faster than any joint of this
dance, or further than it can bend: the frames are replaced by interpolation. If that joint is the
pelvis or the lower spine, everything hangs on it, so the whole body is interpolated.

Symbols (axes: f frames · j joints)
    R     rotations relative to the parent      (f, j, 3, 3)
    bad   frames of a joint to be replaced      (f, j) bool
"""

from collections.abc import Iterable
from dataclasses import replace

import torch
from torch import Tensor

from dancediff.data.bvh import BVH
from dancediff.motion.rotation import rotation_angle, slerp

# degrees from the rest pose that a joint can reach in dance, by the SMPL-24 joint it is mapped to
REACH = {
    **dict.fromkeys(("belly", "spine", "chest", "neck"), 90.0),
    **dict.fromkeys(("head", "lankle", "rankle"), 110.0),
    **dict.fromkeys(("lwrist", "rwrist"), 120.0),
}
ENDS = ("head", "lankle", "rankle", "lwrist", "rwrist")  # half turns are looked for here
TRUNK = ("root", "belly")
THIGHS = ("lhip", "rhip")  # a knee on the wrong side leaves the ankle right: see `retarget`
FLIPPED = 110.0  # degrees: beyond this an end is tried with half a turn taken off
TOO_FAST = (10.0, 25.0)  # radians a second: never an outlier below, always one above
TIMES_P95 = 8.0  # between the two: so many times the joint's own 95th percentile
ROOT_TOO_FAST = 4.0  # metres a second
MARGIN = 0.05  # seconds around an outlier; the recording's own filter smears it
SHORT = 0.35  # seconds: a suspect range up to this length is replaced whole
GAP = 0.12  # seconds of good frames between two outliers that are replaced with them


def repair(
    bvh: BVH, joints: dict[str, str], *, suspect: Iterable[tuple[int, int]] = ()
) -> tuple[BVH, list[dict]]:
    r"""Turn flipped ends back and interpolate outliers.

    A frame is an outlier where $\omega_j > \operatorname{clip}(8\,P_{95}(\omega_j), 10, 25)$ rad/s
    for the joint's speed $\omega_j$, or where the joint is bent beyond `REACH`; the stretch around
    it in which the joint is bent more than in 95 % of the take goes with it. ``suspect`` ranges
    (first and last frame, known from elsewhere) up to `SHORT` are replaced in any case; in longer
    ones, where most frames are good, half of that speed is enough. ``joints`` maps SMPL-24 names
    to names of the file.

    Returns the motion and what was done: dicts with joint ("body" for all), first and last frame
    (of ``bvh``) and kind ("flip", "spike"), fit for JSON.

    >>> from dancediff.data.bvh import BVH
    >>> R = torch.eye(3).double().repeat(60, 1, 1, 1)
    >>> R[30] = torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])           # a quarter turn
    >>> zero = torch.zeros(60, 1, 3).double()
    >>> still, done = repair(BVH(("hip",), (-1,), zero[0], R, zero, 30.0), {"root": "hip"})
    >>> round(abs(still.rotations - torch.eye(3)).max().item(), 6), done[0]["joint"]
    (0.0, 'body')
    """
    if bvh.num_frames < 2:  # nothing moves, so nothing moves too fast
        return bvh, []
    R, done = _unflip(bvh, joints)
    bad = _outliers(bvh, R, joints, list(suspect))
    trunk = [bvh.index(joints[name]) for name in TRUNK if name in joints]
    body = close_gaps(bad[:, trunk].any(1, keepdim=True), bvh.fps)
    bad = close_gaps(bad, bvh.fps)
    done += [{"joint": "body", "first": a, "last": b, "kind": "spike"} for a, b in runs(body[:, 0])]
    for j, name in enumerate(bvh.names):
        own = runs(bad[:, j] & ~body[:, 0])
        done += [{"joint": name, "first": a, "last": b, "kind": "spike"} for a, b in own]
    R = R.clone()
    for j in (bad | body).any(0).nonzero()[:, 0].tolist():
        R[:, j] = _bridge_rotations(R[:, j], bad[:, j] | body[:, 0])
    move = bridge(bvh.translations, body[:, 0])
    return replace(bvh, rotations=R, translations=move), done


def runs(mask: Tensor) -> list[tuple[int, int]]:
    """First and last index of each stretch of True.

    >>> runs(torch.tensor([True, False, True, True]))
    [(0, 0), (2, 3)]
    """
    edge = torch.cat([mask.new_zeros(1), mask, mask.new_zeros(1)]).int().diff()
    starts, stops = (edge == 1).nonzero()[:, 0], (edge == -1).nonzero()[:, 0] - 1
    return list(zip(starts.tolist(), stops.tolist(), strict=True))


def _unflip(bvh: BVH, joints: dict[str, str]) -> tuple[Tensor, list[dict]]:
    """Take half a turn off the ends that bend further than any can, where that brings them back."""
    R, done = bvh.rotations.clone(), []
    half_turns = torch.diag_embed(2 * torch.eye(3).double() - 1)  # about x, y, z
    for name in (joints[end] for end in ENDS if end in joints):
        j = bvh.index(name)
        for first, last in runs(torch.rad2deg(rotation_angle(R[:, j])) > FLIPPED):
            part = slice(first, last + 1)
            options = R[part, j] @ half_turns[:, None]
            bend = rotation_angle(options).mean(1).rad2deg()
            if bend.min() < FLIPPED / 2:
                R[part, j] = options[bend.argmin()]
                done.append({"joint": name, "first": first, "last": last, "kind": "flip"})
    return R, done


def _outliers(bvh: BVH, R: Tensor, joints: dict[str, str], suspect: list) -> Tensor:
    """Which frames of which joints nobody danced, (f, j)."""
    speed = rotation_angle(R[:-1].mT @ R[1:]) * bvh.fps
    limit = (TIMES_P95 * speed.quantile(0.95, dim=0)).clamp(*TOO_FAST).repeat(len(speed), 1)
    for first, last in suspect:
        part = slice(max(first - 1, 0), max(last + 1, 0))  # it may lie before the first frame
        limit[part] /= 2 if last - first > SHORT * bvh.fps else torch.inf
    fast = speed > limit
    root = bvh.index(joints["root"]) if "root" in joints else 0  # others may stand above it
    path = bvh.world()[0][:, root]
    fast[:, root] |= path.diff(dim=0).norm(dim=-1) * bvh.fps > ROOT_TOO_FAST
    bad = torch.zeros(R.shape[:2], dtype=torch.bool)
    bad[:-1] |= fast
    bad[1:] |= fast
    for name, reach in REACH.items():
        if name in joints:
            j = bvh.index(joints[name])
            bend = rotation_angle(R[:, j]).rad2deg()
            bad[:, j] |= bend > reach
            for first, last in runs(bend > bend.quantile(0.95)):  # how it got there is wrong too
                bad[first : last + 1, j] |= bad[first : last + 1, j].any()
    bad[:, [bvh.index(joints[name]) for name in THIGHS if name in joints]] = False
    return bad


def close_gaps(bad: Tensor, fps: float) -> Tensor:
    """Widen every bad stretch by `MARGIN` and join stretches closer than `GAP`, bool (f, j)."""

    def dilate(mask: Tensor, frames: int) -> Tensor:
        window = 2 * frames + 1
        pool = torch.nn.functional.max_pool1d
        return pool(mask.double().mT[None], window, 1, frames)[0].mT > 0

    margin, gap = round(MARGIN * fps), round(GAP * fps / 2)
    return ~dilate(~dilate(bad, margin + gap), gap)


def _neighbours(bad: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Last good frame before, first good one after, and how far on the way each frame is."""
    index = torch.arange(len(bad))
    before = torch.where(bad, -1, index).cummax(0).values
    after = torch.where(bad, len(bad), index).flip(0).cummin(0).values.flip(0)
    before, after = (
        torch.where(before < 0, after, before),
        torch.where(after >= len(bad), before, after),
    )  # at the ends of the take the nearest good frame is repeated
    return before, after, (index - before).double() / (after - before).clamp_min(1)


def _bridge_rotations(R: Tensor, bad: Tensor) -> Tensor:
    """Replace bad frames of one joint, (f, 3, 3)."""
    if bad.all():
        return R
    before, after, w = _neighbours(bad)
    return torch.where(bad[:, None, None], slerp(R[before], R[after], w), R)


def bridge(x: Tensor, bad: Tensor) -> Tensor:
    """Replace bad frames of anything (f, ...) by straight lines between good ones.

    >>> bridge(torch.tensor([1.0, 9.0, 2.0]).double(), torch.tensor([False, True, False])).tolist()
    [1.0, 1.5, 2.0]
    """
    if not bad.any() or bad.all():
        return x
    before, after, w = _neighbours(bad)
    return torch.lerp(x[before], x[after], w.view(-1, *[1] * (x.ndim - 1)))
