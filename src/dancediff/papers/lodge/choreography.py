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
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dancediff.data.choreographer.structure import Section
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE, MotionSpec, Normalizer
from dancediff.papers.lodge.primitives import SOFT_PER_LOCAL, Layout, spread_evenly
from dancediff.papers.lodge.stitch import Plan

FIXED = (1 / 8, 2 / 8, 5 / 8, 6 / 8)  # of a local: frames 32, 64, 160, 192 of 256


@dataclass(frozen=True, eq=False)
class Cues:
    """What local diffusion is told about each local.

    value      the cues where there are any, else zeros    (L, f, d)
    hard       frames that must be met                     bool (L, f)
    soft       frames that are suggested                   bool (L, f)
    channels   features that cues speak of: all but root   bool (d,)
    positions  the middle of each soft cue                 int (L, 4), or (L, 2) without mirroring
    """

    value: Tensor
    hard: Tensor
    soft: Tensor
    channels: Tensor
    positions: Tensor

    def normalized(self, normalizer: Normalizer) -> "Cues":
        """From metres and matrices to the network's units, on its device; zero where no cue is."""
        value = normalizer.normalize(self.value.to(normalizer.low))
        masks = {
            name: getattr(self, name).to(value.device) for name in ("hard", "soft", "channels")
        }
        cued = (masks["hard"] | masks["soft"])[..., None]
        return replace(self, value=value * cued, **masks)


@dataclass(frozen=True, eq=False)
class Arrangement:
    """The primitives that each local passes, before they lie among its frames.

    tail       first half of the hard primitive that ends it       (L, 4, d)
    head       second half of the one that begins it               (L, 4, d)
    soft       the others                                          (L, c, 8, d)
    positions  the middle of each of them                          int (L, c)

    A sixth of the memory that `Cues` need, which `dance` makes of a few locals at a time.
    """

    tail: Tensor
    soft: Tensor
    head: Tensor
    positions: Tensor
    layout: Layout
    spec: MotionSpec = LODGE

    def cues(self, part: slice = slice(None)) -> Cues:
        """The cues of some locals."""
        parts = (x[part] for x in (self.tail, self.soft, self.head, self.positions))
        return lay_out(*parts, self.layout, self.spec)


def make_cues(primitives: Tensor, plan: Plan, **options) -> Cues:
    """The cues of all locals; the arguments are those of `arrange`.

    >>> from dancediff.papers.lodge.stitch import plan
    >>> cues = make_cues(torch.randn(1, 13, 8, 139), plan(1024), beats=range(0, 1024, 15))
    >>> cues.value.shape, cues.positions[0].tolist()
    (torch.Size([4, 256, 139]), [45, 105, 165, 225])
    """
    return arrange(primitives, plan, **options).cues()


def arrange(
    primitives: Tensor,
    plan: Plan,
    *,
    beats: Iterable[int] = (),
    sections: Sequence[Section] = (),
    mirror: bool = True,
    beat_align: bool = True,
    spec: MotionSpec = LODGE,
) -> Arrangement:
    """Split hard primitives at borders, mirror soft ones, put them on beats, repeat with the song.

    ``beats``: frames of the song. ``sections``: see `song_structure.find_sections`, in frames; a
    section that comes again gets the cues of its first time, every second time mirrored.
    ``mirror=False``: two soft cues in each local instead of four, and none mirrored.
    ``beat_align=False``, or a local without beats: fixed frames.

    Source: Lodge section 3.2 and appendix B.  Differs: the released code mirrors normalised
    vectors, always uses fixed frames and knows nothing of sections.

    Shapes: primitives (G, p, 8, d) metres and 6-D rotations -> Arrangement of L locals, in metres.
    Raises: ValueError when the primitives are not those of the plan.

    >>> from dancediff.papers.lodge.stitch import plan
    >>> arrange(torch.randn(1, 13, 8, 139), plan(1024)).soft.shape
    torch.Size([4, 4, 8, 139])
    """
    layout = plan.layout
    tail, soft, head = split_at_borders(chain(primitives, plan), layout)
    if mirror:
        soft = torch.stack([soft, mirror_features(soft, spec)], dim=2).flatten(1, 2)
    beats = sorted(map(int, beats)) if beat_align else []
    positions = torch.tensor(
        [
            cue_positions([b - start for b in beats], layout, count=soft.shape[1])
            for start in plan.locals
        ]
    )
    soft = repeat_sections(soft, positions, plan, sections, mirror=mirror, spec=spec)
    return Arrangement(tail, soft, head, positions, layout, spec)


def lay_out(
    tail: Tensor,
    soft: Tensor,
    head: Tensor,
    positions: Tensor,
    layout: Layout,
    spec: MotionSpec = LODGE,
) -> Cues:
    """Put halves of hard primitives and whole soft ones where they belong.

    Shapes: tail, head (L, 4, d), soft (L, c, 8, d), positions (L, c) -> Cues.
    """
    n, half, offsets = layout.local_frames, layout.length // 2, layout.offsets
    value = head.new_zeros(len(head), n, head.shape[-1])
    hard = torch.zeros(len(head), n, dtype=torch.bool, device=value.device)
    suggested = torch.zeros_like(hard)
    for frames, what in ((offsets[half:], head), (n + offsets[:half], tail)):
        value[:, frames], hard[:, frames] = what, True
    for j, row in enumerate(positions):
        frames = row[:, None] + offsets
        value[j, frames], suggested[j, frames] = soft[j], True
    channels = torch.ones(value.shape[-1], dtype=torch.bool, device=value.device)
    channels[spec.root] = False
    return Cues(value, hard, suggested, channels, positions)


def chain(primitives: Tensor, plan: Plan) -> Tensor:
    """The primitives of all globals as one row: h s s h s s h ... h.

    Where a global takes over, the last hard primitive of the one before is kept; a last global that
    lies over the one before gives only the locals that are new.

    Source: Lodge's code.

    Shapes: primitives (G, p, 8, d) -> (3 L + 1, 8, d).
    Raises: ValueError when the primitives are not those of the plan.
    """
    expected = (len(plan.globals), plan.layout.num_primitives, plan.layout.length)
    if primitives.ndim != 4 or primitives.shape[:3] != expected:
        raise ValueError(
            f"primitives has shape {tuple(primitives.shape)}; this plan needs {(*expected, 'd')}"
        )
    each = 1 + SOFT_PER_LOCAL
    pieces = [primitives[0, :1]]
    for part, shared in zip(primitives, plan.shared, strict=True):
        pieces.append(part[each * shared + 1 :])
    return torch.cat(pieces)[: each * len(plan.locals) + 1]


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


def repeat_sections(
    soft: Tensor,
    positions: Tensor,
    plan: Plan,
    sections: Sequence[Section],
    *,
    mirror: bool = True,
    spec: MotionSpec = LODGE,
) -> Tensor:
    """Give a section that comes again the soft cues of its first time, every second time mirrored.

    Each cue is that of the first time whose distance from its section's start is the most alike.

    Source: ours, for Lodge's third choreographic rule (section 3.1).

    Shapes: soft (L, c, 8, d), positions (L, c) -> (L, c, 8, d).
    """
    at = (torch.tensor(plan.locals)[:, None] + positions).flatten()
    cues = soft.flatten(0, 1)
    again = cues.clone()
    first: dict[str, Section] = {}
    for section in sections:
        origin = first.setdefault(section.label, section)
        known = ((at >= origin.start) & (at < origin.stop)).nonzero()[:, 0]
        here = ((at >= section.start) & (at < section.stop)).nonzero()[:, 0]
        if origin is section or not len(known):
            continue
        into = (at[here] - section.start) % (origin.stop - origin.start)
        same = known[(at[known] - origin.start - into[:, None]).abs().argmin(dim=1)]
        flip = mirror and section.mirrored
        again[here] = mirror_features(cues[same], spec) if flip else cues[same]
    return again.view_as(soft)
