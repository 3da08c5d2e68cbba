r"""Song structure: which parts of a song come back later, and dance that comes back with them.

Read first: Lodge section 3.1, third choreographic rule · `dancediff.data.choreographer.structure`.

Symbols (axes: f frames · m = 35 music features · q phrases)
    M   music features, raw                          (f, m)
    S   how alike two phrases sound, -1 ... 1        (q, q)
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.data.choreographer.structure import Section
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE
from dancediff.music.features import LATE, beat_frames
from dancediff.music.sections import PHRASE, phrase_similarity
from dancediff.papers.lodge.choreography import Arrangement
from dancediff.papers.lodge.segments import Segments

ALIKE = 0.7  # two phrases are the same material from here on


def find_sections(M: Tensor) -> list[Section]:
    """Sections of a song, from what its features repeat.

    Starts and stops are frames of the dance, as soft cues are: a section's first beat is its own.

    Phrases of 8 beats are compared as a whole. Alike phrases in a row are one section, so a loop
    that never changes is no repetition; one that returns after something else is.

    The paper asks for it ("the arrangement of dance should align with the structure of the music")
    and names no method; the released code has none.

    Shapes: M (f, 35), raw.  A song with less than two phrases of beats has no sections.

    >>> find_sections(torch.zeros(900, 35))
    []
    """
    beats = beat_frames(M)
    if len(beats) <= 2 * PHRASE:
        return []
    S = phrase_similarity(M, beats)
    labels = [0]
    for q in range(1, len(S)):
        nearest = int(S[q, :q].argmax())
        labels.append(labels[nearest] if S[q, nearest] >= ALIKE else q)
    borders = np.maximum(beats[: len(S) * PHRASE + 1 : PHRASE] - round(LATE * FPS), 0)
    return sections_of(labels, borders.tolist())


def sections_of(labels: Sequence, borders: Sequence[int]) -> list[Section]:
    """Join neighbours with the same label, and count how often a label came before.

    >>> [(s.start, s.stop, s.times) for s in sections_of("aaba", [0, 10, 20, 30, 40])]
    [(0, 20, 0), (20, 30, 0), (30, 40, 1)]
    """
    sections: list[Section] = []
    for label, (start, stop) in zip(map(str, labels), pairwise(borders), strict=True):
        if sections and sections[-1].label == label:
            sections[-1] = replace(sections[-1], stop=stop)
        else:
            times = sum(s.label == label for s in sections)
            sections.append(Section(start, stop, label, times))
    return sections


def repeat_sections(
    arrangement: Arrangement,
    segments: Segments,
    sections: Sequence[Section],
    *,
    mirror: bool,
) -> Arrangement:
    """Give a section that comes again the soft cues of its first time, every second time mirrored.

    Each cue comes as long after its section's start as it did the first time. What would lie on a
    border of locals or on another section's cue is left out; in a local with too few of them one
    comes twice in one place.

    Source: Lodge section 3.1 asks for it in its third rule, and names no method.

    >>> from dancediff.papers.lodge.choreography import arrange
    >>> from dancediff.papers.lodge.segments import segments_of
    >>> segments = segments_of(1024)
    >>> first, again = Section(0, 512, "verse", 0), Section(512, 1024, "verse", 2)
    >>> made = arrange(torch.randn(1, 13, 8, 139), segments, mirror=True)
    >>> made = repeat_sections(made, segments, [first, again], mirror=True)
    >>> torch.equal(made.soft[:2], made.soft[2:])
    True
    """
    n, span = segments.layout.local_frames, segments.layout.span
    starts = torch.tensor(segments.locals)[:, None]
    soft, positions = arrangement.soft.clone(), arrangement.positions.clone()
    first: dict[str, Section] = {}
    for section in sections:
        origin = first.setdefault(section.label, section)
        if origin is section:
            continue
        at = starts + positions  # of cues in the song (l, c), with those that were moved already
        then, here = (((at >= s.start) & (at < s.stop)) for s in (origin, section))
        # a longer section begins the first one's material again
        rounds = torch.arange(section.start, section.stop, origin.stop - origin.start)
        again = (rounds[:, None] + at[then] - origin.start).flatten()
        cues = soft[then].repeat(len(rounds), 1, 1)
        apart = again.diff(prepend=again[:1] - span) >= span  # else two would lie on each other
        kept = apart & (again < section.stop)
        again, cues = again[kept], cues[kept]
        if mirror and section.mirrored:
            cues = mirror_features(cues, LODGE)
        for j in here.any(dim=1).nonzero()[:, 0].tolist():
            start, free = segments.locals[j], here[j].nonzero()[:, 0]
            fits = (again >= start + span) & (again <= start + n - span)
            fits &= ((again[:, None] - at[j, ~here[j]]).abs() >= span).all(dim=1)
            if fits.any():
                which = torch.arange(len(free)) % int(fits.sum())
                positions[j, free] = again[fits][which] - start
                soft[j, free] = cues[fits][which]
    return replace(arrangement, soft=soft, positions=positions)
