r"""How often dancers run into each other: the trajectory intersection frequency (TIF).

Read first: docs/metrics_collision.md · `dancediff.motion.skeleton`.

Two bodies: capsules around the bones, or discs on the floor. How well capsules stand for a skinned
mesh is measured by ``benchmarks/tif_meshes.py``.

Symbols (axes: n dancers · f frames · j joints)
    joints    positions, metres, y up                         (n, f, 24, 3)
    pairs     which two dancers, the smaller number first     (p, 2)
    touching  whether a pair's bodies overlap in a frame      (p, f)
"""

import torch
from torch import Tensor

from dancediff.metrics.inputs import as_group
from dancediff.motion.skeleton import SMPL24

# Points that SMPL-24 has no joint for: on from joint a through joint b, this far beyond b, metres.
_TIPS = (
    ("skull", "neck", "head", 0.07),  # the middle of the skull
    ("lfingers", "lwrist", "lhand", 0.07),  # a hand is 18 cm long, its fingers a little curled
    ("rfingers", "rwrist", "rhand", 0.07),
)
# (name, joint a, joint b, radius in metres) on the right side and the middle; the left is the same.
# A radius is girth / 2 pi of an adult's limb, averaged along it, rounded to 5 mm.
_MIDDLE = (
    ("pelvis", "lhip", "rhip", 0.11),  # half its depth front to back, 22 cm
    ("abdomen", "root", "spine", 0.12),  # half its depth, 23 cm; it is wider than deep
    ("thorax", "spine", "chest", 0.12),
    ("upper chest", "lcollar", "rcollar", 0.08),  # half its depth just under the neck, 16 cm
    ("neck base", "chest", "neck", 0.07),
    ("neck", "neck", "head", 0.055),  # girth 35 cm
    ("head", "head", "skull", 0.09),  # 15 cm wide, 19 cm long
)
_SIDE = (
    ("shoulder", "collar", "shoulder", 0.06),  # 12 cm over the joint
    ("upper arm", "shoulder", "elbow", 0.045),  # girth 28 cm
    ("forearm", "elbow", "wrist", 0.035),  # girth 22 cm, from 26 below the elbow to 17 at the wrist
    ("hand", "wrist", "fingers", 0.03),  # 8 cm wide, 3 cm thick
    ("thigh", "hip", "knee", 0.075),  # girth 47 cm, from 56 at the hip to 38 at the knee
    ("shin", "knee", "ankle", 0.05),  # girth 31 cm, from 37 at the calf to 23 above the ankle
    ("foot", "ankle", "toe", 0.035),  # 9 cm wide, 5 cm high over the instep; ends at the ball
)
POINTS = (*SMPL24.names, *(name for name, *_ in _TIPS))  # what CAPSULES count
CAPSULES: tuple[tuple[str, int, int, float], ...] = (
    *((name, POINTS.index(a), POINTS.index(b), radius) for name, a, b, radius in _MIDDLE),
    *(
        (f"{word} {name}", POINTS.index(side + a), POINTS.index(side + b), radius)
        for word, side in (("left", "l"), ("right", "r"))
        for name, a, b, radius in _SIDE
    ),
)
DISC = 0.5  # metres between two roots on the floor under which discs overlap
BODIES = ("capsule", "disc")


def tif(joints: Tensor, *, bodies: str = "capsule", ordered: bool = False) -> float:
    r"""Trajectory intersection frequency: how many pairs of dancers overlap in a frame.

    $$\text{TIF} = \frac1f \sum_{k=1}^{f} \sum_{i<j} \mathbb 1[B_i(k) \cap B_j(k) \neq \emptyset]$$

    so n dancers in one place score n (n - 1) / 2. ``ordered`` sums over i and j both ways, as the
    papers do, which doubles it. ``bodies`` says what B is: "capsule" the `CAPSULES`, "disc" a
    circle half a metre across under the root.

    Source: AIOZ-GDance, where B is the SMPL surface.
    Differs: no code for it is public, and SMPL may not be shipped, so no number from here may be
    put beside one from a paper. Hands that hold each other count, as they do there.

    Shapes: joints (n, f, 24, 3) metres.
    Raises: ValueError for fewer than 2 dancers, NaN, or unknown bodies.

    >>> apart = torch.zeros(2, 4, 24, 3)
    >>> apart[1, 2:, :, 0] = 3.0                             # the second dancer leaves half-way
    >>> tif(apart), tif(apart, ordered=True), tif(apart, bodies="disc")
    (0.5, 1.0, 0.5)
    """
    touching = touches(joints, bodies=bodies)
    return (2 if ordered else 1) * touching.sum().item() / touching.shape[1]


def touches(joints: Tensor, *, bodies: str = "capsule") -> Tensor:
    """Whether the bodies of each pair of dancers overlap in each frame; arguments as in `tif`.

    Shapes: joints (n, f, 24, 3) metres -> bool (p, f), pairs (0, 1), (0, 2), ..., (1, 2), ...

    >>> touches(torch.zeros(3, 2, 24, 3)).shape
    torch.Size([3, 2])
    """
    joints = as_group(joints, 30.0, least=1, dancers=2)  # the frame rate does not matter
    if bodies not in BODIES:
        raise ValueError(f"bodies={bodies!r} is unknown; use one of {', '.join(BODIES)}")
    first, second = torch.combinations(torch.arange(len(joints))).unbind(1)
    if bodies == "disc":
        floor = joints[:, :, 0, [0, 2]]
        return (floor[first] - floor[second]).norm(dim=-1) < DISC
    if joints.shape[2] != SMPL24.num_joints:
        raise ValueError(f"joints has {joints.shape[2]} joints, {bodies} bodies need all 24")
    return _capsules_touch(body_points(joints), first, second)


def body_points(joints: Tensor) -> Tensor:
    """The joints and three points beyond them, in the order of ``POINTS``.

    Shapes: (..., 24, 3) metres -> (..., 27, 3).

    >>> body_points(torch.zeros(2, 24, 3)).shape
    torch.Size([2, 27, 3])
    """
    tips = []
    for _, a, b, length in _TIPS:
        end = joints[..., SMPL24.index(b), :]
        along = torch.nn.functional.normalize(end - joints[..., SMPL24.index(a), :], dim=-1)
        tips.append(end + length * along)
    return torch.cat([joints, torch.stack(tips, dim=-2)], dim=-2)


def _capsules_touch(points: Tensor, first: Tensor, second: Tensor) -> Tensor:
    """Narrow down by the whole body, then by bones' middles; measure only what is left."""
    radius = points.new_tensor([c[3] for c in CAPSULES])
    root = points[:, :, 0]
    reach = (points - root[:, :, None]).norm(dim=-1).amax(-1) + radius.max()  # (n, f)
    gap = (root[first] - root[second]).norm(dim=-1)
    touching = torch.zeros(len(first), points.shape[1], dtype=torch.bool)
    rows = (gap < reach[first] + reach[second]).nonzero()
    for some in rows.split(4096):  # the distances of an hour are gigabytes
        pair, frame = some.unbind(1)
        hit = _touching_rows(points, root, radius, (first[pair], second[pair], frame))
        touching[pair[hit], frame[hit]] = True
    return touching


def _touching_rows(points: Tensor, root: Tensor, radius: Tensor, where: tuple) -> Tensor:
    """Which pairs of dancers i and j touch in a frame; ``where``: i, j and frames (r,)."""
    i, j, frame = where
    a, b = (torch.tensor([c[k] for c in CAPSULES]) for k in (1, 2))
    # from here in metres from the first dancer's root, which keeps the digits of far stages
    P = points[i, frame] - root[i, frame, None]
    Q = points[j, frame] - root[i, frame, None]
    half_p, half_q = (P[:, b] - P[:, a]).norm(dim=-1) / 2, (Q[:, b] - Q[:, a]).norm(dim=-1) / 2
    middle = torch.cdist((P[:, a] + P[:, b]) / 2, (Q[:, a] + Q[:, b]) / 2)
    near = middle < (half_p + radius)[:, :, None] + (half_q + radius)[:, None]
    row, k, m = near.nonzero(as_tuple=True)
    apart = segment_distance(P[row, a[k]], P[row, b[k]], Q[row, a[m]], Q[row, b[m]])
    return row[apart < radius[k] + radius[m]]


def segment_distance(a: Tensor, b: Tensor, c: Tensor, d: Tensor) -> Tensor:
    r"""Shortest distance between the segments ab and cd.

    $$\min_{s,t \in [0,1]} \lVert a + s(b-a) - c - t(d-c) \rVert$$

    It lies at an end of one of them (four point-to-segment distances), or inside both, where the
    line between them is square to both. A segment may be a point.

    Shapes: four times (..., 3) metres -> (...).

    >>> p = torch.tensor([[-1.0, 0, 0], [1, 0, 0], [0, 2, -1], [0, 2, 1]])    # two that cross
    >>> segment_distance(*p).item()
    2.0
    """
    ends = torch.stack([_to_segment(a, c, d), _to_segment(b, c, d),
                        _to_segment(c, a, b), _to_segment(d, a, b)])  # fmt: skip
    best = ends.amin(0)
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = ((x * y).sum(-1) for x, y in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    det = uu * vv - uv**2
    safe = det.clamp_min(1e-30)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    inside = (det > 1e-12 * uu * vv) & (s > 0) & (s < 1) & (t > 0) & (t < 1)
    line = (w + s[..., None] * u - t[..., None] * v).norm(dim=-1)
    return torch.where(inside, torch.minimum(line, best), best)


def _to_segment(p: Tensor, a: Tensor, b: Tensor) -> Tensor:
    along = b - a
    s = ((p - a) * along).sum(-1) / (along**2).sum(-1).clamp_min(1e-30)
    return (p - a - s.clamp(0, 1)[..., None] * along).norm(dim=-1)
