r"""Song structure: which parts of a song come back later, and dance that comes back with them.

Read first: Lodge section 3.1, third choreographic rule · `dancediff.data.choreographer.structure`.

Symbols (axes: f frames · m = 35 music features · q phrases)
    M   music features, raw                          (f, m)
    S   how alike two phrases sound, -1 ... 1        (q, q)
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import torch
from torch import Tensor

from dancediff.data.choreographer.structure import Section
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE
from dancediff.music.features import beat_frames
from dancediff.music.sections import PHRASE, phrase_similarity
from dancediff.papers.lodge.choreography import Arrangement
from dancediff.papers.lodge.segments import Segments

ALIKE = 0.7  # two phrases are the same material from here on


def find_sections(M: Tensor) -> list[Section]:
    """Sections of a song, from what its features repeat; starts and stops are frames.

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
    return sections_of(labels, beats[: len(S) * PHRASE + 1 : PHRASE].tolist())


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

    Each cue is that of the first time whose distance from its section's start is the most alike.

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
    at = (torch.tensor(segments.locals)[:, None] + arrangement.positions).flatten()
    cues = arrangement.soft.flatten(0, 1)
    repeated = cues.clone()
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
        repeated[here] = mirror_features(cues[same], LODGE) if flip else cues[same]
    return replace(arrangement, soft=repeated.view_as(arrangement.soft))
