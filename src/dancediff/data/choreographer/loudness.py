r"""How a dance follows the loudness of its music.

Read first: docs/choreographer.md · `dancediff.music.energy` ·
`dancediff.data.choreographer.moves`.

A genre has its own usual speed. Loud music is danced faster than that, quiet music slower: a move
is taken larger or smaller, so that the way its joints go on a count is the way that is wanted.

$$a(E) = 0.4 + 1.1\,\operatorname{clip}\big((E - 0.25) / 0.55,\ 0,\ 1\big),\qquad
  w_\text{move}(\text{size}) = a(E)\,\bar w$$

Symbols (axes: f frames · k counts)
    E     energy of the music, 0..1                          (f,) or (k,)
    a     amount of movement, 1 is usual                     (k,)
    w     way of the mean joint on one count of a move, metres
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from dancediff.data.choreographer.breath import ACCENT_COUNTS, ACCENTS, BREATHING, HOLD
from dancediff.data.choreographer.grid import Grid
from dancediff.data.choreographer.moves import Genre, Move
from dancediff.data.choreographer.structure import Section

AMOUNT = (0.4, 1.5)  # of usual movement, in silence and in the loudest music
_QUIET, _LOUD = 0.25, 0.8  # energies of these
_OVER = 1.0  # standard deviation in counts, over which the movement is looked at
_GAIN = (3.0, 1.6)  # of size for way: who travels goes most of the way in any size
_GOES = 0.02  # metres a count that a place moves, of one who travels
_LEAST, _MOST = 0.165, 0.75  # metres a second: nobody freezes, and nobody rushes
_FAR = 0.11  # metres a count that a group goes when much is moved
_SIZES = (0.25, 1.2)  # a move is never danced smaller or larger
_EASY = (0.6, 1.1)  # a move that has this size suits the music
_CHOICE = 4  # moves among which the music chooses
_LEAP = 0.3  # of energy, between a quieter part and a drop, or a louder one and a break
_HELD = 3  # counts of a break that are held at most
_BREAK = 8  # counts; a longer quiet part is no break


@dataclass(frozen=True)
class Loudness:
    """What the score knows about loudness; see the module's symbols.

    wanted  metres that the mean joint shall go on every count  (k,)
    drops   counts on which the music is suddenly louder
    breaks  counts (start, stop) on which it is suddenly quiet, for a while
    gaps    counts (start, stop) without a beat
    ways    of the genre's moves by name, metres a count
    """

    wanted: np.ndarray
    drops: tuple[int, ...]
    breaks: tuple[tuple[int, int], ...]
    gaps: tuple[tuple[int, int], ...]
    ways: dict[str, float]

    @property
    def usual(self) -> float:
        """The genre's usual way on one count."""
        return float(np.median(list(self.ways.values())))

    def amount(self, start: int, stop: int) -> float:
        """Mean amount of movement on counts ``start`` to ``stop``."""
        last = len(self.wanted) - 1
        return float(self.wanted[min(max(start, 0), last) : max(stop, 1)].mean()) / self.usual

    def size(self, move: Move, wanted: float) -> float:
        """How large a move is danced, for an amount of movement."""
        return wanted * self.usual / self.ways.get(move.name, self.usual)

    def far(self, counts: int, wanted: float) -> float:
        """How far dancers go in a travel of some counts, metres, for an amount of movement."""
        return _FAR * wanted**2 * counts

    def suiting(self, moves: list[Move], wanted: float) -> Move:
        """The first of the next moves that suits an amount, or else the nearest."""
        sizes = [self.size(move, wanted) for move in moves[:_CHOICE]]
        for move, size in zip(moves, sizes, strict=False):
            if _EASY[0] <= size <= _EASY[1]:
                return move
        return moves[int(np.abs(np.array(sizes) - 0.8).argmin())]


def amount(energy: np.ndarray) -> np.ndarray:
    """How much is moved, beside the usual amount, (...,) -> (...,).

    >>> amount(np.array([0.0, 0.5, 1.0])).round(3).tolist()
    [0.4, 0.9, 1.5]
    """
    low, high = AMOUNT
    return low + (high - low) * np.clip((energy - _QUIET) / (_LOUD - _QUIET), 0, 1)


def heard(energy: np.ndarray, grid: Grid, genre: Genre, ways: dict[str, float]):
    """What the score knows of the loudness, and counts on which the groove follows it.

    Shapes: energy (f,) -> `Loudness`, `Grid`.
    """
    at = np.searchsorted(grid.beat, np.arange(grid.length) + np.array([[-0.5], [0.5]]))
    low, high = np.clip(at, 0, len(energy) - 1)
    total = np.concatenate([[0.0], np.cumsum(energy)])
    on_count = (total[high + 1] - total[low]) / (high + 1 - low)
    inside = {k for k in range(grid.length) if not any(a <= k < b for a, b in grid.gaps)}
    rise = _rises(energy, grid)
    drops = [k for k in _peaks(rise) if k in inside]
    breaks = []
    for k in _peaks(-rise):
        quiet = on_count[k + 1 :] < on_count[min(k + 1, len(on_count) - 1)] + 0.5 * _LEAP
        long = int(quiet.argmin()) if not quiet.all() else len(quiet)
        if k in inside and 2 <= long <= _BREAK:
            breaks.append((k, k + 1 + min(long, _HELD)))
    usual = float(np.median(list(ways.values())))
    longer = np.sqrt(grid.pace * (sum(genre.tempo) / 2) / 60)  # long counts: larger movements
    low, high = (end * longer * usual for end in AMOUNT)
    low, high = np.maximum(low, _LEAST * grid.pace), np.minimum(high, _MOST * grid.pace)
    wanted = low + (high - low) * (amount(on_count) - AMOUNT[0]) / (AMOUNT[1] - AMOUNT[0])
    loud = Loudness(wanted, tuple(drops), tuple(breaks), grid.gaps, ways)
    return loud, replace(grid, swing=grid.swing * amount(energy))


def _peaks(rise: np.ndarray) -> list[int]:
    """Counts on which a rise is large, and larger than on four counts before and after.

    >>> _peaks(np.array([0.0, 0.2, 0.5, 0.5, 0.1, 0.0, 0.2]))
    [2]
    """
    padded = np.pad(rise, 4, constant_values=-np.inf)
    return [
        k
        for k, value in enumerate(rise.tolist())
        if value > _LEAP
        and value > padded[k : k + 4].max()
        and value >= padded[k + 5 : k + 9].max()
    ]


def _rises(energy: np.ndarray, grid: Grid) -> np.ndarray:
    """By how much the music is louder after each count than before it, (k,)."""
    frame = np.searchsorted(grid.beat, np.arange(grid.length))
    total = np.concatenate([[0.0], np.cumsum(energy)])

    def mean(start: int, stop: int) -> np.ndarray:
        a, b = (np.clip(frame + x, 0, len(energy)) for x in (start, stop))
        return np.where(b > a, (total[b] - total[a]) / np.maximum(b - a, 1), np.nan)

    rise = mean(10, 45) - mean(-70, -10)
    return np.nan_to_num(rise)


def cut_at_drops(sections: list[Section], drops) -> list[Section]:
    """The same sections, but on a drop one begins; a border up to 2 counts away moves there.

    >>> [s.start for s in cut_at_drops([Section(0, 15, "a", 0), Section(15, 40, "b", 0)], [16, 30])]
    [0, 16, 30]
    """
    for drop in drops:
        out: list[Section] = []
        for section in sections:
            if section.silent or not section.start - 2 <= drop <= section.stop + 2:
                out.append(section)
            elif abs(drop - section.start) <= 2 and out and not out[-1].silent:
                out[-1] = replace(out[-1], stop=drop)
                out.append(replace(section, start=drop))
            elif section.start + 4 <= drop <= section.stop - 4:
                out += [replace(section, stop=drop), replace(section, start=drop)]
            else:
                out.append(section)
        sections = out
    return sections


def follow(counts: list, centre: np.ndarray, loud: Loudness, rng: np.random.Generator):
    """The score's counts, each as large as the music is loud, with accents and held breaks.

    All dancers accent a drop in the same way. Who is on the way to another formation holds nothing.

    Shapes: centre (n, k, 2).
    """
    accents = {}
    for drop in loud.drops:
        move = ACCENTS[rng.integers(len(ACCENTS))]
        accents.update({drop + k: (move, k) for k in range(ACCENT_COUNTS)})
    held, silent = (
        {k for start, stop in parts for k in range(start, stop)}
        for parts in (loud.breaks, loud.gaps)
    )
    wanted = _padded(loud.wanted, len(counts[0])) / loud.usual
    out = []
    for row, goes in zip(counts, _goes(centre), strict=True):
        new = []
        for k, planned in enumerate(row):
            count, size = planned, float(wanted[k])
            if count.move.name in BREATHING and k in silent:
                size = 0.85 + 0.3 * size
            elif k in accents and k not in silent:
                move, within = accents[k]
                count, size = replace(count, move=move, within=within, arms=None), max(size, 0.9)
            elif k in held and not goes[k]:
                count = replace(count, move=HOLD, arms=None)
            else:
                size = loud.size(count.move, size)
            size = float(np.clip(size, *_SIZES))
            new.append(replace(count, size=size * count.size, stride=size))
        out.append(new)
    return out


def corrected(counts: list, centre: np.ndarray, ways: np.ndarray, loud: Loudness) -> list[list]:
    """The counts, smaller where the group moves more than the music asks for, and larger.

    Shapes: centre (n, k, 2), ways (n, k) metres that dancers go on their counts.
    """
    wanted = gaussian_filter1d(_padded(loud.wanted, ways.shape[1]), _OVER, mode="nearest")
    found = gaussian_filter1d(ways.mean(0), _OVER, mode="nearest")
    change = np.log(wanted / np.maximum(found, 1e-3))
    sizes = np.array([[count.size for count in row] for row in counts])
    sizes = np.clip(sizes * np.exp(change * np.where(_goes(centre), *_GAIN)), *_SIZES)
    return [
        [
            replace(count, size=float(size), stride=float(size))
            for count, size in zip(row, mine, strict=True)
        ]
        for row, mine in zip(counts, sizes, strict=True)
    ]


def _goes(centre: np.ndarray) -> np.ndarray:
    """Who is on the way on which count, (n, k, 2) -> (n, k)."""
    return np.linalg.norm(np.gradient(centre, axis=1), axis=-1) > _GOES


def _padded(x: np.ndarray, num: int) -> np.ndarray:
    """The first ``num`` values; the last one goes on."""
    return np.pad(x, (0, max(0, num - len(x))), mode="edge")[:num]
