r"""Do dancers stay who they are, and do they end where they were asked to?

Read first: docs/metrics_swaps.md · `dancediff.motion.order`.

Symbols (axes: n dancers · f frames)
    root   pelvis positions, metres, y up                                       (n, f, 3)
    seams  first frames of the segments a long dance was joined from, without 0
    swap   swap[k] = the dancer, counted from the left at the first frame, who stands k-th from the
           left at the last frame; 0..n-1 = nobody swaps                        (n,)
"""

import math
import operator
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from dancediff.axes import LATERAL, ON_FLOOR
from dancediff.motion.order import check_order, left_to_right, swap_mode

JUMP_SPEED = 0.12 * 30  # metres a second: 12 cm in a frame of 1/30 s
SEAM_REACH = 3 / 30  # seconds before and after a seam: 3 frames
KINDS = ("identity", "neighbours", "outer", "rotation")


class AbruptSwap(NamedTuple):
    """One event: a "jump" of one dancer, or an "exchange" of two at a seam.

    ``frame`` is the first frame after the jump, or the seam; ``metres`` how far the dancer jumped,
    or the farther of the two moved.
    """

    kind: str
    frame: int
    dancers: tuple[int, ...]
    metres: float


def abrupt_swaps(
    root: Tensor, *, fps: float = 30.0, seams: Sequence[int] | None = None
) -> list[AbruptSwap]:
    r"""Moments at which somebody is suddenly somewhere else; their number is the metric.

    A *jump* is a step of the root faster than 12 cm in 1/30 s, each frame on its own:

    $$\lVert p_{i} - p_{i-1} \rVert > 0.12 \cdot 30 / \mathrm{fps}$$

    An *exchange* is two dancers trading places within 3 frames (1/10 s) on either side of a seam s.
    They have traded when each is nearer to where the other was, summed in squares on the floor,
    which is to say that the line from one to the other has turned by more than a right angle:

    $$(p_i - p_j)_{s-3} \cdot (p_i - p_j)_{s+3} < 0 \quad\text{on } (x, z)$$

    It is not counted again when either of the two jumps between those frames. An ordinary change
    of the left-to-right order is neither, at a seam or elsewhere: dancers who pass each other
    keep their own paths, and the line between them turns slowly. Segments that are joined by a fade
    exchange dancers over the whole overlap: this metric does not see that. TIF does when two trade
    places, as they meet halfway.

    Source: our own; no paper has it. 12 cm a frame is 3.6 m/s, which dancers on a stage hardly
    reach.

    Shapes: root (n, f, 3) metres, f >= 2.
    Raises: ValueError naming a wrong shape, NaN, fps, or a seam that is no frame of 1..f-1.

    >>> root = torch.zeros(2, 9, 3)
    >>> root[1, :, 0] = 1.0
    >>> abrupt_swaps(root)
    []
    >>> root[:, 5:] = root[:, 5:].flip(0)                             # they trade places at once
    >>> [(swap.kind, swap.frame, swap.dancers) for swap in abrupt_swaps(root, seams=[5])]
    [('jump', 5, (0,)), ('jump', 5, (1,))]
    """
    if not 0 < fps < math.inf:
        raise ValueError(f"fps={fps} must be positive")
    root = _check_root(root, frames=2)
    step = root.diff(dim=1).norm(dim=-1)  # (n, f - 1)
    jumps = (step > JUMP_SPEED / fps).nonzero().tolist()
    found = [AbruptSwap("jump", i + 1, (d,), step[d, i].item()) for d, i in jumps]
    reach = max(1, round(SEAM_REACH * fps))
    for seam in _check_seams(seams, root.shape[1]):
        found += _exchanges(root, seam, reach, jumps)
    return sorted(found, key=lambda swap: (swap.frame, swap.dancers))


def _exchanges(root: Tensor, seam: int, reach: int, jumps: list) -> list[AbruptSwap]:
    before, after = max(seam - reach, 0), min(seam + reach, root.shape[1] - 1)
    jumping = {d for d, i in jumps if before <= i < after}
    floor = root[:, (before, after)][..., ON_FLOOR]
    line = floor[:, None] - floor[None]
    traded = (line[:, :, 0] * line[:, :, 1]).sum(-1) < 0
    moved = (floor[:, 1] - floor[:, 0]).norm(dim=-1)
    return [
        AbruptSwap("exchange", seam, (i, j), moved[[i, j]].max().item())
        for i, j in traded.triu().nonzero().tolist()
        if not jumping & {i, j}
    ]


def swap_obedience(roots: Sequence[Tensor], swaps: Sequence) -> dict[str, float]:
    r"""How many of some dances end in the order that was asked for.

    $$\frac1N \sum_{d=1}^N \mathbb 1\big[S(\text{root}_d) = \text{swap}_d\big]$$

    with S from `final_order`. The whole order must be right. "all" is the share over all dances;
    for groups of three there is also one share for each kind of swap asked for, as
    `permutation_kind` names it. Kinds that nobody asked for are left out.

    Source: our own; ``swap`` as `generate` takes it. Who ignores the swap and keeps the order
    obeys every identity, so read the other kinds; chance is 1/6 for three dancers.
    Differs from every other metric: turning the stage changes it, left and right being the point.

    Shapes: roots N times (n, f, 3) metres, swaps N times (n,) int; n may differ between dances.
    Raises: ValueError when there is no dance, the numbers differ, or a swap is no order.

    >>> root = torch.zeros(3, 2, 3)
    >>> root[:, 0, 0], root[:, 1, 0] = torch.tensor([-1.0, 0, 1]), torch.tensor([0.0, -1, 1])
    >>> swap_obedience([root, root], [(1, 0, 2), (0, 1, 2)])
    {'all': 0.5, 'identity': 0.0, 'neighbours': 1.0}
    """
    if len(roots) != len(swaps) or not len(roots):
        raise ValueError(f"{len(roots)} roots and {len(swaps)} swaps; pass one swap for each dance")
    hits: dict[str, list[bool]] = {"all": []}
    for root, swap in zip(roots, swaps, strict=True):
        hit = obeys(root, swap)
        hits["all"].append(hit)
        if len(root) == 3:
            hits.setdefault(permutation_kind(swap), []).append(hit)
    order = [kind for kind in ("all", *KINDS) if kind in hits]
    return {kind: sum(hits[kind]) / len(hits[kind]) for kind in order}


def obeys(root: Tensor, swap) -> bool:
    """Whether one dance ends in the order that was asked for.

    Shapes: root (n, f, 3) metres, swap (n,) int.
    Raises: ValueError as `swap_obedience`.

    >>> obeys(torch.tensor([[[0.0, 0, 0]], [[1.0, 0, 0]]]), [0, 1])
    True
    """
    return final_order(root) == tuple(check_order(swap, len(root)).tolist())


def by_rank(root: Tensor, swap) -> list[int]:
    """An order of a dance's own dancers, each named by the place where it starts from the left.

    Only who began by ``start=`` in another order than left to right has another number than place.

    Shapes: root (n, f, 3) metres, swap (n,) int -> n numbers.
    Raises: ValueError as `swap_obedience`.

    >>> by_rank(torch.tensor([[[1.0, 0, 0]], [[-1.0, 0, 0]]]), [1, 0])  # nobody is to move
    [0, 1]
    """
    rank = left_to_right(_check_root(root, frames=1)[:, 0, LATERAL]).argsort()
    return rank[check_order(swap, len(root))].tolist()


def final_order(root: Tensor) -> tuple[int, ...]:
    """Who ends where: entry k is the start rank of the dancer who ends k-th from the left.

    `swap_mode` of the first and the last frame.

    Shapes: root (n, f, 3) metres -> n numbers.

    >>> final_order(torch.tensor([[[0.0, 0, 0], [2.0, 0, 0]], [[1.0, 0, 0], [1.0, 0, 0]]]))
    (1, 0)
    """
    x = _check_root(root, frames=1)[..., LATERAL]
    return tuple(swap_mode(x[:, 0], x[:, -1]).tolist())


def permutation_kind(swap) -> str:
    """What three dancers are asked to do: one of ``KINDS``.

    Identity: nobody swaps. Neighbours: the middle trades with the left or the right one. Outer: the
    left and the right one trade. Rotation: all three move, two by one place, one by two.

    Raises: ValueError when swap is no order of three.

    >>> [permutation_kind(s) for s in ((0, 1, 2), (0, 2, 1), (2, 1, 0), (2, 0, 1))]
    ['identity', 'neighbours', 'outer', 'rotation']
    """
    swap = check_order(swap, 3).tolist()
    kept = [k for k, dancer in enumerate(swap) if k == dancer]
    if len(kept) == 1:
        return "outer" if kept == [1] else "neighbours"
    return "identity" if kept else "rotation"


def _check_root(root: Tensor, *, frames: int) -> Tensor:
    root = torch.as_tensor(root)
    shape = tuple(root.shape)
    if len(shape) != 3 or shape[2] != 3 or shape[0] < 1:
        raise ValueError(f"root has shape {shape}; expected (n, f, 3): pass Motion.root")
    if shape[1] < frames:
        raise ValueError(f"root has {shape[1]} frames, this needs {frames}; pass a longer dance")
    if not root.isfinite().all():
        raise ValueError("root has NaN or infinite values; repair or cut the motion first")
    return root.detach().cpu().double()


def _check_seams(seams, num_frames: int) -> list[int]:
    try:
        frames = [operator.index(seam) for seam in ([] if seams is None else seams)]
    except TypeError:
        frames = [0]  # is refused
    if not all(0 < frame < num_frames for frame in frames):
        raise ValueError(
            f"seams={seams!r} must be frames of 1..{num_frames - 1}, the first of each segment"
        )
    return sorted(set(frames))
