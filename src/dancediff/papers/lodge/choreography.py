r"""Choreographic augmentation: from the primitives of a song to the cues of its locals.

Read first: Lodge section 3.2 ("Method Overview") and appendix B.

Symbols (axes: p primitives · k frames of a primitive · f frames of a local · d = 139)
    G, L   globals and locals of the song
    h      hard primitive: its first half ends one local, its second half starts the next
    s      soft primitive: danced at a beat, and a second time mirrored

    local     | h  ..  s  ..  s mirrored  ..  s'  ..  s' mirrored  ..  h |
    frames     0:4     4 beats of the music, or 32, 64, 160, 192   252:256
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE, Normalizer
from dancediff.papers.lodge.primitives import SOFT_PER_LOCAL, Layout
from dancediff.papers.lodge.segments import Segments

FIXED = (1 / 8, 2 / 8, 5 / 8, 6 / 8)  # of a local: frames 32, 64, 160, 192 of 256


@dataclass(frozen=True, eq=False)
class Cues:
    """The condition of local diffusion for each local: frames that must be met, or are suggested.

    Shapes: value (L, f, d), zero where there is no cue; hard, soft (L, f) bool.
    """

    value: Tensor
    hard: Tensor
    soft: Tensor

    def normalized(self, normalizer: Normalizer) -> "Cues":
        """From metres and matrices to the network's units, on its device; zero where no cue is."""
        value = normalizer.normalize(self.value.to(normalizer.low))
        hard, soft = self.hard.to(value.device), self.soft.to(value.device)
        return Cues(value * (hard | soft)[..., None], hard, soft)


@dataclass(frozen=True, eq=False)
class Arrangement:
    """The primitives that each local passes, before they lie among its frames.

    tail       first half of the hard primitive that ends it       (L, 4, d)
    soft       the others                                          (L, c, 8, d)
    head       second half of the hard one that begins it          (L, 4, d)
    positions  the middle of each soft one                         int (L, c)

    A sixth of the memory that `Cues` need, which sampling makes of a few locals at a time.
    """

    tail: Tensor
    soft: Tensor
    head: Tensor
    positions: Tensor
    layout: Layout

    def cues(self, part: slice = slice(None)) -> Cues:
        """The cues of some locals: halves of hard primitives and whole soft ones in their places.

        Shapes: -> Cues of as many locals.
        """
        tail, soft, head = self.tail[part], self.soft[part], self.head[part]
        n, half, offsets = self.layout.local_frames, self.layout.length // 2, self.layout.offsets
        value = head.new_zeros(len(head), n, head.shape[-1])
        hard = torch.zeros(len(head), n, dtype=torch.bool, device=value.device)
        suggested = torch.zeros_like(hard)
        for frames, primitive in ((offsets[half:], head), (n + offsets[:half], tail)):
            value[:, frames], hard[:, frames] = primitive, True
        for j, row in enumerate(self.positions[part]):
            frames = row[:, None] + offsets
            value[j, frames], suggested[j, frames] = soft[j], True
        return Cues(value, hard, suggested)


def arrange(
    primitives: Tensor,
    segments: Segments,
    *,
    beats: Iterable[int] = (),
    mirror: bool,
) -> Arrangement:
    """Split hard primitives at borders, mirror soft ones, and put them on beats.

    ``beats``: frames of the dance on which a beat sounds, as `music.features.dance_frames` gives
    them; in a local without any, cues lie at fixed frames. ``mirror=False``: two soft cues in each
    local instead of four, and none mirrored.

    Source: Lodge section 3.2 and appendix B.  Differs: the released code mirrors normalised vectors
    and always uses fixed frames.

    Shapes: primitives (G, p, 8, d) metres and 6-D rotations -> Arrangement of L locals, in metres.
    Raises: ValueError when the primitives are not those of the segments; for a beat between two
    frames.

    >>> from dancediff.papers.lodge.segments import segments_of
    >>> primitives, beats = torch.randn(1, 13, 8, 139), range(0, 1024, 15)
    >>> made = arrange(primitives, segments_of(1024), beats=beats, mirror=True)
    >>> made.soft.shape, made.positions[0].tolist()
    (torch.Size([4, 4, 8, 139]), [45, 105, 165, 225])
    """
    layout = segments.layout
    tail, soft, head = split_at_borders(chain(primitives, segments), layout)
    if mirror:
        soft = torch.stack([soft, mirror_features(soft, LODGE)], dim=2).flatten(1, 2)
    beats = whole_frames(beats)
    positions = torch.tensor(
        [
            cue_positions([b - start for b in beats], layout, count=soft.shape[1])
            for start in segments.locals
        ]
    )
    return Arrangement(tail, soft, head, positions, layout)


def whole_frames(beats: Iterable[float]) -> list[int]:
    """Beats in order, as frames.

    Raises: ValueError for a beat between two frames: seconds times 30 lie up to a frame beside
    `music.features.dance_frames`, and another first beat moves all cues.

    >>> whole_frames([30.0, 15])
    [15, 30]
    """
    beats = sorted(beats)
    between = [beat for beat in beats if beat != int(beat)]
    if between:
        raise ValueError(
            f"beats must be whole frames, not {between[0]:g}; `music.features.dance_frames(M)` "
            "gives those of a song"
        )
    return [int(beat) for beat in beats]


def chain(primitives: Tensor, segments: Segments) -> Tensor:
    """The primitives of all globals as one row: h s s h s s h ... h.

    Where a global takes over, the last hard primitive of the one before is kept; a last global that
    lies over the one before gives only the locals that are new.

    Source: Lodge's code.

    Shapes: primitives (G, p, 8, d) -> (3 L + 1, 8, d).
    Raises: ValueError when the primitives are not those of the segments.
    """
    layout = segments.layout
    expected = (len(segments.globals), layout.num_primitives, layout.length)
    if primitives.ndim != 4 or primitives.shape[:3] != expected:
        raise ValueError(
            f"primitives has shape {tuple(primitives.shape)}; "
            f"these segments need {(*expected, 'd')}"
        )
    each = 1 + SOFT_PER_LOCAL
    pieces = [primitives[0, :1]]
    for part, shared in zip(primitives, segments.shared, strict=True):
        pieces.append(part[each * shared + 1 :])
    return torch.cat(pieces)[: each * len(segments.locals) + 1]


def split_at_borders(row: Tensor, layout: Layout) -> tuple[Tensor, Tensor, Tensor]:
    """Cut each hard primitive in half: the tail of one local, and the head of the next.

    Of the first hard primitive only the second half is used, of the last only the first.

    Source: Lodge "Parallel Inference".

    Shapes: row (3 L + 1, 8, d) -> tails (L, 4, d), soft (L, 2, 8, d), heads (L, 4, d).

    >>> row = torch.arange(32.0).reshape(4, 8, 1)                  # h s s h
    >>> tail, _, head = split_at_borders(row, Layout())
    >>> head.flatten().tolist(), tail.flatten().tolist()
    ([4.0, 5.0, 6.0, 7.0], [24.0, 25.0, 26.0, 27.0])
    """
    half = layout.length // 2
    hard = row[:: 1 + SOFT_PER_LOCAL]
    soft = row[:-1].unflatten(0, (-1, 1 + SOFT_PER_LOCAL))[:, 1:]
    return hard[1:, :half], soft, hard[:-1, half:]


def cue_positions(beats: Sequence[int], layout: Layout, *, count: int) -> list[int]:
    """The middles of a local's soft cues: beats, else the middles of the largest gaps.

    Beats too close to an end for a cue beside the hard ones are passed over. Without any beat the
    cues come at fixed frames: two pairs, each in the first half of its half.

    Shapes: beats (k,) frames counted from the local's start.

    >>> cue_positions([], Layout(), count=4), cue_positions([], Layout(), count=2)
    ([32, 64, 160, 192], [32, 160])
    >>> cue_positions([2, 50, 251], Layout(), count=4)
    [50, 101, 153, 204]
    """
    n, span = layout.local_frames, layout.span
    if not any(span <= b <= n - span for b in beats):
        return [round(share * n) for share in FIXED[:: len(FIXED) // count]]
    return spread_evenly(beats, count, 0, n, margin=span, apart=span)


def spread_evenly(
    candidates: Iterable[int], count: int, start: int, stop: int, *, margin: int, apart: int
) -> list[int]:
    """``count`` frames of start ... stop: candidates as far as there are, else in the largest gaps.

    Kept are those ``margin`` from both ends and ``apart`` from each other. Of too many, evenly
    spaced ones are taken; too few are completed by halving the largest gap; without any the
    frames are spread evenly.

    >>> spread_evenly([40, 80, 120, 160, 200], 2, 0, 256, margin=8, apart=8)
    [80, 160]
    >>> spread_evenly([40], 2, 0, 256, margin=8, apart=8)
    [40, 148]
    >>> spread_evenly([], 2, 0, 256, margin=8, apart=8)
    [64, 192]
    """
    chosen: list[int] = []
    for frame in sorted(map(int, candidates)):
        far = not chosen or frame - chosen[-1] >= apart
        if far and start + margin <= frame <= stop - margin:
            chosen.append(frame)
    if not chosen:
        return [start + (2 * i + 1) * (stop - start) // (2 * count) for i in range(count)]
    if len(chosen) > count:
        return [chosen[(2 * i + 1) * len(chosen) // (2 * count)] for i in range(count)]
    while len(chosen) < count:
        fences = [start, *chosen, stop]
        gaps = [after - before for before, after in pairwise(fences)]
        k = gaps.index(max(gaps))
        chosen.insert(k, (fences[k] + fences[k + 1]) // 2)
    return chosen
