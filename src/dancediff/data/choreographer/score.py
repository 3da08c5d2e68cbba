r"""The score: which move each dancer does on which beat, and where the group stands.

Read first: `dancediff.data.choreographer.moves`.

Eight beats make a phrase, six where a bar has three. A section dances its phrases in one formation
and ends with a phrase that travels to the next one; some travels let two dancers change places.
Where the music has no beat people breathe, and walk to another formation if there is time.
"""

from dataclasses import dataclass, field

import numpy as np

from dancediff.data.choreographer.breath import STROLL, WALKS, breathing
from dancediff.data.choreographer.formations import (
    curved_paths,
    formation_names,
    plan_transition,
    slots,
)
from dancediff.data.choreographer.loudness import Loudness, follow
from dancediff.data.choreographer.moves import Genre, Move
from dancediff.data.choreographer.relations import WAITING, draw_relations, right, role_of
from dancediff.data.choreographer.structure import LEVELS, PHRASE, PREFERRED, Section

_BUSY = 0.95  # amount of movement above which nobody waits
_MIRRORED = 0.4  # of the ways to another formation
_CALM = 0.9  # amount of movement with which a way takes twice as long


@dataclass(frozen=True)
class Count:
    """What one dancer does on one beat."""

    move: Move
    within: int  # count of the move
    flip: bool  # danced mirrored
    size: float = 1.0
    arms: Move | None = None  # whose arms are borrowed
    stride: float = 1.0  # size of the steps from the dancer's place
    low: float = 0.0  # centimetres lower than the move


@dataclass
class Score:
    """Plan of a whole dance on the beat grid.

    counts[i][k] what dancer i does on beat k
    centre       where each dancer's place is on every beat, (n, k, 2) metres
    formations   (beat, name, slots (n, 2) by dancer)
    relations    (beat, name)
    """

    counts: list[list[Count]]
    centre: np.ndarray
    formations: list[tuple[int, str, np.ndarray]] = field(default_factory=list)
    relations: list[tuple[int, str]] = field(default_factory=list)


@dataclass
class Material:
    """What belongs to one label of a song: chosen once, danced every time the label comes."""

    moves: list[Move]
    travel: Move
    relations: tuple[str, str]  # of its phrases, by turns
    goes: bool  # a short section, too, ends with a way to another formation


def write_score(
    n: int,
    genre: Genre,
    sections: list[Section],
    rng: np.random.Generator,
    swap: bool | None,
    loud: Loudness | None = None,
) -> Score:
    """Draw a plan for n dancers over the given sections (beat 0 to the last section's stop)."""
    writer = _Writer(n, genre, loud, rng, swap, sections[0].start)
    known: dict[str, Material] = {}
    free = list(genre.moves)
    for section in sections:
        if section.silent:
            writer.breathe(section.stop - section.start)
            continue
        if section.label not in known:
            known[section.label] = _choose(genre, free, section.label, n, rng)
        writer.dance(section, known[section.label])
    score = writer.score
    lead = -min(sections[0].start, 0)  # beats that are over before the dance begins
    score.counts = [row[lead:] for row in score.counts]
    score.centre = score.centre[:, lead:]
    score.formations = [(max(at, 0), name, place) for at, name, place in score.formations]
    score.relations = [(max(at, 0), name) for at, name in score.relations]
    score.counts = score.counts if loud is None else follow(score.counts, score.centre, loud, rng)
    return score


class _Writer:
    """Writes a score from its beginning to its end; knows where the group stands."""

    def __init__(self, n: int, genre: Genre, loud: Loudness | None, rng, swap, start: int):
        self.n, self.genre, self.loud, self.rng = n, genre, loud, rng
        self.swap, self.swaps_left = swap, 1 if swap else 0
        self.scale = rng.uniform(1.1, 1.3)
        self.name = str(rng.choice(formation_names(n)))
        self.place = self.scale * slots(n, self.name)[rng.permutation(n)]  # (n, 2) by dancer
        self.start = start  # number of the first beat
        first = [(start, self.name, self.place.copy())]
        self.score = Score([[] for _ in range(n)], np.zeros((n, 0, 2)), first)

    @property
    def now(self) -> int:
        """Number of the beat that is written next."""
        return self.start + self.score.centre.shape[1]

    def wanted(self, start: int, beats: int) -> float:
        """Amount of movement that the music asks for; 1 is usual."""
        return 1.0 if self.loud is None else self.loud.amount(start, start + beats)

    def dance(self, section: Section, part: Material) -> None:
        """A section on the beat: groups change formation every two or three phrases of it."""
        block, left, phrase = 2 * self.genre.phrase, section.stop - section.start, 0
        while left > 0:
            beats = left if left < 2 * block or self.n == 1 else block
            phrase += self.block(section, part, phrase, beats)
            left -= beats

    def block(self, section: Section, part: Material, first: int, beats: int) -> int:
        """Phrases in one formation, then the way to the next one; returns how many phrases.

        ``first`` is the number of the first phrase in its section.
        """
        phrase, move, way = self.genre.phrase, part.travel, self.genre.phrase
        if phrase != PHRASE:  # six beats are too few to go far
            way = 2 * phrase
        elif self.wanted(self.now + beats - way, way) < _CALM:
            move, way = STROLL, 2 * way
        elif self.loud is not None:
            move = self.loud.suiting(
                [part.travel, *self.genre.travel], self.wanted(self.now + beats - way, way)
            )
        goes = part.goes or self.swaps_left > 0
        travel = way if beats >= way + (phrase // 2 if goes else 2 * phrase) else 0
        hold = beats - travel - (beats % phrase if travel else 0)
        if travel and hold <= 0:
            hold = beats - travel
        sizes = 1 + self.rng.uniform(-0.05, 0.03, 1 + hold // phrase)
        lent = _lent_arms(part, section, self.rng)
        for k, at in enumerate(range(0, hold, phrase)):
            size = float(sizes[k]) * (LEVELS.get(section.label, 0.95) if self.loud is None else 1.0)
            self.phrase(part, first + k, section.mirrored, size, lent, min(phrase, hold - at))
        if travel:
            mirror = self.n > 1 and self.rng.random() < _MIRRORED
            self.relate("mirror" if mirror else "unison")
            self.travel(
                move, travel, [section.mirrored ^ (mirror and x) for x in right(self.place)]
            )
        self.stay(self.genre.rest, beats - hold - travel, section.mirrored)
        return -(-hold // phrase)

    def phrase(
        self, part: Material, number: int, flip: bool, size: float, lent: dict, beats: int
    ) -> None:
        """One phrase of a section, in its relation."""
        wanted, half = self.wanted(self.now, beats), self.genre.phrase // 2
        relation = part.relations[number % 2]
        if self.loud is not None and wanted > _BUSY and relation in WAITING:
            relation = "pairs"
        self.relate(relation)
        moves = [self.move(part, number + k, wanted) for k in (0, 1)]
        for i, row in enumerate(self.score.counts):
            role = role_of(relation, self.place, i, number)
            move, side = moves[role.other], flip ^ role.flip
            arms = None if move.whole else lent.get(move.name)
            for k in range(beats):
                within = k - role.delay - half * (role.half or 0)
                if role.waits or within < 0 or (role.half is not None and k // half != role.half):
                    row.append(Count(self.genre.rest, k, side, size))
                else:
                    row.append(Count(move, within, side, size, arms, low=role.low))
        self.stand(beats)

    def move(self, part: Material, number: int, wanted: float) -> Move:
        """The move of a section's phrase: the next one, or the one that suits the loudness."""
        at = number % len(part.moves)
        moves = part.moves[at:] + part.moves[:at]
        if self.loud is None:
            return moves[0]
        if self.now in self.loud.drops:  # what goes on after an accent must not be a turn
            moves = [move for move in moves if not move.whole]
        return self.loud.suiting(moves, wanted)

    def breathe(self, beats: int) -> None:
        """A stretch without a beat: on the spot, and slowly to another formation by its end."""
        while beats:
            self.relate("breath")
            walk = PHRASE if beats >= PHRASE else 0
            rest = beats - walk if beats < 2 * PHRASE + 4 else PHRASE
            orders = breathing(self.n, self.rng)
            for row, order in zip(self.score.counts, orders, strict=True):
                row.extend(Count(order[k // PHRASE], k % PHRASE, False) for k in range(rest))
            self.stand(rest)
            if walk:
                self.travel(WALKS[self.rng.integers(len(WALKS))], walk, [False] * self.n)
            beats -= rest + walk

    def travel(self, move: Move, beats: int, flips: list[bool]) -> None:
        """All go to the next formation; ``flips`` says who does it mirrored."""
        names = [name for name in formation_names(self.n) if name != self.name]
        seen = [name for _, name, _ in self.score.formations]
        fewest = min(map(seen.count, names))
        fresh = names if self.n == 1 else [name for name in names if seen.count(name) == fewest]
        name = str(self.rng.choice(fresh))
        if self.swap is None:
            order = "any" if self.rng.random() < 0.6 else "keep"
        else:
            order = "swap" if self.swaps_left > 0 else "keep"
        choices = [(name, order)]
        if self.loud is not None:
            orders = {order, "keep"} if self.swap is None else {order}
            choices = [(name, order) for name in names for order in sorted(orders)]
        ways = [
            (x, *plan_transition(self.place, self.scale * slots(self.n, x), self.rng, order=how))
            for x, how in choices
        ]
        if self.loud is not None:  # quiet music carries nobody far
            far = self.loud.far(beats, self.wanted(self.now, beats))
            ways.sort(key=lambda way: _misses(self.place, way[1], far))
        name, stop, bulge, swapped = ways[0]
        if not np.array_equal(stop, self.place):  # else no way is safe: the group stays
            self.name = name
        self.swaps_left -= swapped
        way = curved_paths(self.place, stop, bulge, beats + 1)[:, 1:]
        self.together(move, flips, way)
        self.place = stop
        self.score.formations.append((self.now, self.name, stop.copy()))

    def stay(self, move: Move, beats: int, flip: bool) -> None:
        """All do one move where they stand."""
        self.together(move, [flip] * self.n, np.repeat(self.place[:, None], beats, axis=1))

    def together(self, move: Move, flips: list[bool], way: np.ndarray) -> None:
        """All do one move on their ways (n, k, 2)."""
        long = len(move.channels[0])
        for row, flip in zip(self.score.counts, flips, strict=True):
            row.extend(Count(move, k % long, flip) for k in range(way.shape[1]))
        self.score.centre = np.concatenate([self.score.centre, way], axis=1)

    def stand(self, beats: int) -> None:
        """Everybody's place stays where it is."""
        still = np.repeat(self.place[:, None], beats, axis=1)
        self.score.centre = np.concatenate([self.score.centre, still], axis=1)

    def relate(self, relation: str) -> None:
        """From the next beat on the group has this relation."""
        known = self.score.relations
        if not known or known[-1][1] != relation:
            known.append((self.now, relation))


def _misses(place: np.ndarray, stop: np.ndarray, far: float) -> float:
    """By how much a way is too long or too short; a group that cannot go misses most."""
    way = float(np.linalg.norm(stop - place, axis=-1).mean())
    return abs(way - far) if way > 0 else np.inf


def _choose(genre: Genre, free: list[Move], label: str, n: int, rng) -> Material:
    """Moves for a label: of the energies it prefers, and new ones if there are."""
    wanted = PREFERRED.get(label, (1, 2, 3))
    pool = [m for m in free if m.energy in wanted] or free
    rest = [m for m in genre.moves if m not in pool]
    order = [pool[i] for i in rng.permutation(len(pool))] + [
        rest[i] for i in rng.permutation(len(rest))
    ]
    for move in order[:2]:
        if move in free and len(free) > 2:
            free.remove(move)
    relations = draw_relations(label, n, rng)
    travel = genre.travel[rng.integers(len(genre.travel))]
    return Material(order, travel, relations, bool(rng.random() < 0.6) or n > 1)


def _lent_arms(part: Material, section: Section, rng) -> dict[str, Move]:
    """A varied section keeps its feet and borrows the arms of other moves."""
    if not section.varied:
        return {}
    lenders = [m for m in part.moves if not m.whole]
    return {m.name: lenders[rng.integers(len(lenders))] for m in lenders if rng.random() < 0.6}
