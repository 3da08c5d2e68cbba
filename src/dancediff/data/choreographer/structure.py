r"""Song structure on the beat grid: which section a beat belongs to, and how often it came before.

A section that comes again repeats its material: the second time mirrored, the third time as it was
but varied, the fourth time mirrored and varied.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dancediff.music.sections import PHRASE

IN_THREE = 6  # beats of a phrase where a bar has three
_SONG = ("verse", "chorus", "verse", "chorus", "bridge", "chorus")
# how much of a move's size a section dances, and which moves' energies it prefers
LEVELS = {"intro": 0.90, "verse": 0.94, "bridge": 0.97, "outro": 0.90, "chorus": 1.0}
PREFERRED = {"intro": (1,), "outro": (1,), "verse": (1, 2), "bridge": (1, 2, 3), "chorus": (2, 3)}


@dataclass(frozen=True)
class Section:
    """Beats ``start`` to ``stop`` of the grid; ``times`` is how often its label came before.

    ``silent``: the music has no beat here.
    """

    start: int
    stop: int
    label: str
    times: int
    silent: bool = False

    @property
    def mirrored(self) -> bool:
        """Every second time."""
        return self.times % 2 == 1

    @property
    def varied(self) -> bool:
        """From the third time on."""
        return self.times >= 2


def given_sections(sections, beats: np.ndarray, first: int, num_beats: int) -> list[Section]:
    """Sections in seconds -> sections in beats, without gaps, from beat 0 to ``num_beats``.

    ``first`` is the beat number of ``beats[0]``.
    Raises: ValueError naming the section that is not (start, stop, label) with start < stop.

    >>> given_sections([(1.0, 3.0, "verse")], np.arange(8) * 0.5, 1, 12)[1]
    Section(start=3, stop=12, label='verse', times=0, silent=False)
    """
    starts: list[tuple[int, str]] = []
    for section in sections:
        if len(section) != 3 or not float(section[0]) < float(section[1]):
            raise ValueError(f"sections has {section!r}; give (start, stop, label) in seconds")
        at = int(np.abs(beats - float(section[0])).argmin()) + first
        if not starts or at > starts[-1][0]:
            starts.append((at, str(section[2])))
    if not starts or starts[0][0] > 0:
        starts.insert(0, (0, "intro"))
    return _number(starts, num_beats)


def drawn_sections(
    num_beats: int, rng: np.random.Generator, lead: int | None, phrase: int = PHRASE
) -> list[Section]:
    """A plausible song structure; ``lead`` beats of the first section are already over.

    >>> [s.label for s in drawn_sections(40, np.random.default_rng(0), 0)][:2]
    ['verse', 'chorus']
    """
    lead = int(rng.choice([0, 0, 4, 8])) if lead is None else lead
    unit = PHRASE if phrase == PHRASE else 2 * phrase
    at, starts, k = -lead, [], int(rng.integers(0, len(_SONG))) if lead else 0
    while at < num_beats:
        starts.append((at, _SONG[k % len(_SONG)]))
        at += unit * int(rng.choice([2, 2, 4 if k else 2]))
        k += 1
    return _number(starts, num_beats)


def cut_by_gaps(sections: list[Section], gaps) -> list[Section]:
    """The same sections, but stretches without a beat (start, stop) are sections of their own.

    >>> cut_by_gaps([Section(0, 20, "verse", 0)], [(8, 12)])[1]
    Section(start=8, stop=12, label='verse', times=0, silent=True)
    """
    for start, stop in gaps:
        out = []
        for section in sections:
            first, last = section.start, section.stop
            edges = (first, min(max(start, first), last), max(min(stop, last), first), last)
            for (a, b), inside in zip(pairwise(edges), (False, True, False), strict=True):
                if a < b:
                    silent = inside or section.silent
                    out.append(replace(section, start=a, stop=b, silent=silent))
        sections = out
    return sections


def _number(starts: list[tuple[int, str]], num_beats: int) -> list[Section]:
    seen: dict[str, int] = {}
    out = []
    for (start, label), stop in zip(starts, [s for s, _ in starts[1:]] + [num_beats], strict=True):
        if start >= num_beats:
            break
        out.append(Section(start, min(max(stop, start + 1), num_beats), label, seen.get(label, 0)))
        seen[label] = seen.get(label, 0) + 1
    return out
