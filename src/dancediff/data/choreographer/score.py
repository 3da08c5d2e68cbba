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
from dancediff.data.choreographer.structure import LEVELS, PHRASE, PREFERRED, Section

RELATIONS = {  # how dancers relate in a section, and how often
    "verse": {"unison": 3, "canon": 3, "call": 2, "mirror": 1, "solo": 1},
    "chorus": {"unison": 5, "mirror": 3, "canon": 1},
    "bridge": {"solo": 4, "canon": 2, "call": 1},
}
_OTHER = {"unison": 3, "mirror": 1}
_CALM = 0.75  # amount of movement with which a way takes twice as long


@dataclass(frozen=True)
class Count:
    """What one dancer does on one beat."""

    move: Move
    within: int  # count of the move
    flip: bool  # danced mirrored
    size: float = 1.0
    arms: Move | None = None  # whose arms are borrowed
    stride: float = 1.0  # size of the steps from the dancer's place


@dataclass
class Score:
    """Plan of a whole dance on the beat grid.

    counts[i][k] what dancer i does on beat k
    centre       where each dancer's place is on every beat, (n, k, 2) metres
    start        number of the first beat
    formations   (beat, name, slots (n, 2) by dancer)
    relations    (beat, name)
    """

    counts: list[list[Count]]
    centre: np.ndarray
    start: int = 0
    formations: list[tuple[int, str, np.ndarray]] = field(default_factory=list)
    relations: list[tuple[int, str]] = field(default_factory=list)


@dataclass
class Material:
    """What belongs to one label of a song: chosen once, danced every time the label comes."""

    moves: list[Move]
    travel: Move
    relation: str
    soloist: int
    goes: bool  # a short section, too, ends with a way to another formation


@dataclass
class _Stage:
    """Where the group stands while the score is written."""

    place: np.ndarray  # (n, 2) metres by dancer
    name: str
    scale: float
    swap: bool | None
    swaps_left: int
    loud: Loudness | None


def write_score(
    n: int,
    genre: Genre,
    sections: list[Section],
    rng: np.random.Generator,
    swap: bool | None,
    loud: Loudness | None = None,
) -> Score:
    """Draw a plan for n dancers over the given sections (beat 0 to the last section's stop)."""
    scale = rng.uniform(1.1, 1.3)
    name = str(rng.choice(formation_names(n)))
    place = scale * slots(n, name)[rng.permutation(n)]
    stage = _Stage(place, name, scale, swap, 1 if swap else 0, loud)
    score = Score(
        [[] for _ in range(n)], np.zeros((n, 0, 2)), sections[0].start, [(0, name, place.copy())]
    )
    known: dict[str, Material] = {}
    free = list(genre.moves)
    for section in sections:
        if section.silent:
            _breathe(score, stage, section, rng)
            continue
        if section.label not in known:
            known[section.label] = _choose(genre, free, section.label, n, rng)
        _dance(score, stage, genre, known[section.label], section, rng)
    lead = -min(score.start, 0)  # beats that are over before the dance begins
    score.counts = [row[lead:] for row in score.counts]
    score.centre = score.centre[:, lead:]
    score.formations = [(max(at, 0), name, place) for at, name, place in score.formations]
    score.counts = score.counts if loud is None else follow(score.counts, loud, rng)
    return score


def _dance(score: Score, stage: _Stage, genre: Genre, part: Material, section: Section, rng):
    """A section on the beat: phrases in one formation, then the way to the next one."""
    beats, phrase = section.stop - section.start, genre.phrase
    way = phrase if phrase == PHRASE else 2 * phrase  # six beats are too few to go far
    calm = stage.loud and stage.loud.amount(section.stop - way, section.stop) < _CALM
    way = 2 * way if calm and phrase == PHRASE else way
    goes = part.goes or stage.swaps_left > 0
    travel = way if beats >= way + (phrase // 2 if goes else 2 * phrase) else 0
    hold = beats - travel - (beats % phrase if travel else 0)
    if travel and hold <= 0:
        hold = beats - travel
    rest = beats - hold - travel
    score.relations.append((max(section.start, 0), part.relation))
    _hold(score, stage, genre, part, hold, section, rng)
    if travel:
        move = STROLL if calm else part.travel
        _travel(score, stage, move, travel, section.mirrored, rng)
    _together(score, genre.rest, np.repeat(stage.place[:, None], rest, axis=1), section.mirrored)


def _breathe(score: Score, stage: _Stage, section: Section, rng) -> None:
    """A section without a beat: on the spot, and slowly to another formation by its end."""
    score.relations.append((max(section.start, 0), "breath"))
    left = section.stop - section.start
    while left:
        walk = PHRASE if left >= PHRASE else 0
        rest = left - walk if left < 2 * PHRASE + 4 else PHRASE
        orders = breathing(len(stage.place), rng)
        for row, order in zip(score.counts, orders, strict=True):
            row.extend(Count(order[k // PHRASE], k % PHRASE, False) for k in range(rest))
        still = np.repeat(stage.place[:, None], rest, axis=1)
        score.centre = np.concatenate([score.centre, still], axis=1)
        if walk:
            _travel(score, stage, WALKS[rng.integers(len(WALKS))], walk, False, rng)
        left -= rest + walk


def _travel(score: Score, stage: _Stage, move: Move, beats: int, flip: bool, rng) -> None:
    """All go to the next formation."""
    place, n = stage.place, len(stage.place)
    names = rng.permutation([name for name in formation_names(n) if name != stage.name])
    if stage.swap is None:
        order = "any" if rng.random() < 0.6 else "keep"
    else:
        order = "swap" if stage.swaps_left > 0 else "keep"
    found = []
    for name in names[: 1 if stage.loud is None else None].tolist():
        stop, bulge, swapped = plan_transition(
            place, stage.scale * slots(n, name), rng, order=order
        )
        way = np.linalg.norm(stop - place, axis=-1).mean()
        found.append((float(way), name, stop, bulge, swapped))
    if stage.loud is not None:  # quiet music carries nobody far
        now = score.start + score.centre.shape[1]
        far = stage.loud.far(beats, stage.loud.amount(now, now + beats))
        found.sort(key=lambda row: abs(row[0] - far) if row[0] else np.inf)
    _, name, stop, bulge, swapped = found[0]
    if not np.array_equal(stop, place):  # else no way is safe: the group stays
        stage.name = name
    stage.swaps_left -= swapped
    way = curved_paths(place, stop, bulge, beats + 1)[:, 1:]
    _together(score, move, way, flip)
    stage.place = stop
    score.formations.append((score.start + score.centre.shape[1], stage.name, stop.copy()))


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
    odds = RELATIONS.get(label, _OTHER)
    relation = str(rng.choice(list(odds), p=np.array(list(odds.values())) / sum(odds.values())))
    return Material(
        order, genre.travel[rng.integers(len(genre.travel))], relation if n > 1 else "unison",
        int(rng.integers(n)), bool(rng.random() < 0.6),
    )  # fmt: skip


def _hold(score, stage: _Stage, genre, part: Material, beats: int, section: Section, rng) -> None:
    place, long = stage.place, genre.phrase
    n = len(place)
    rank = np.argsort(np.argsort(place[:, 0]))
    size = LEVELS.get(section.label, 0.95) if stage.loud is None else 1.0
    sizes = size * (1 + rng.uniform(-0.05, 0.03, 1 + beats // long))
    lent = _lent_arms(part, section, rng)
    now = score.start + score.centre.shape[1]
    moves = [_phrase(part, stage.loud, p, now + p * long, long) for p in range(len(sizes))]
    for i in range(n):
        delay, waits = _entry(part, i, int(rank[i]))
        flip = section.mirrored ^ (part.relation == "mirror" and place[i, 0] > place[:, 0].mean())
        for k in range(beats):
            phrase = max(k - delay, 0) // long
            move = moves[phrase]
            if waits or k < delay:
                count = Count(genre.rest, k % long, flip, size)
            else:
                arms = None if move.whole else lent.get(move.name)
                count = Count(move, (k - delay) % long, flip, float(sizes[phrase]), arms)
            score.counts[i].append(count)
    still = np.repeat(place[:, None], beats, axis=1)
    score.centre = np.concatenate([score.centre, still], axis=1)


def _phrase(part: Material, loud: Loudness | None, phrase: int, start: int, long: int) -> Move:
    """The move of a section's phrase: the next one, or the one that suits how loud it is."""
    at = phrase % len(part.moves)
    moves = part.moves[at:] + part.moves[:at]
    return moves[0] if loud is None else loud.suiting(moves, loud.amount(start, start + long))


def _entry(part: Material, dancer: int, rank: int) -> tuple[int, bool]:
    """Beats after which a dancer enters, and whether the dancer leaves the section to a soloist."""
    if part.relation == "canon":
        return 2 * (rank % 3), False
    if part.relation == "call":
        return 4 * (rank % 2), False
    return 0, part.relation == "solo" and dancer != part.soloist


def _lent_arms(part: Material, section: Section, rng) -> dict[str, Move]:
    """A varied section keeps its feet and borrows the arms of other moves."""
    if not section.varied:
        return {}
    lenders = [m for m in part.moves if not m.whole]
    return {m.name: lenders[rng.integers(len(lenders))] for m in lenders if rng.random() < 0.6}


def _together(score: Score, move: Move, way: np.ndarray, flip: bool) -> None:
    """All do one move on their ways (n, k, 2)."""
    for row in score.counts:
        row.extend(Count(move, k % len(move.channels[0]), flip) for k in range(way.shape[1]))
    score.centre = np.concatenate([score.centre, way], axis=1)
