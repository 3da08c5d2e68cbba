r"""The score: which move each dancer does on which beat, and where the group stands.

Eight beats make a phrase. A section is two phrases in one formation and one relation (unison,
canon or mirror), then a phrase that travels to the next formation; every second travel lets two
dancers change places.
"""

from dataclasses import dataclass, field

import numpy as np

from dancediff.data.choreographer.footsteps import Step
from dancediff.data.choreographer.formations import (
    curved_paths,
    formation_names,
    plan_transition,
    slots,
)
from dancediff.data.choreographer.vocabulary import FOOTWORK, LIFT, MOVES, TRAVEL, Move

PHRASE = 8  # beats
RELATIONS = ("unison", "mirror", "canon")
_HOME = {"L": np.array([0.105, 0.0]), "R": np.array([-0.105, 0.0])}
_TOE_OUT = {"L": 0.14, "R": -0.14}  # radians


@dataclass
class Score:
    """Plan of a whole dance on the beat grid.

    moves[i][k]  what dancer i does on beat k: (move, beat within the move, mirrored)
    centre       where each dancer's place is on every beat, (n, k, 2) metres
    formations   (beat, name, slots (n, 2) by dancer)
    """

    moves: list[list[tuple[Move, int, bool]]]
    centre: np.ndarray
    formations: list[tuple[int, str, np.ndarray]] = field(default_factory=list)


def write_score(n: int, num_beats: int, rng: np.random.Generator) -> Score:
    """Draw a plan for n dancers that covers at least ``num_beats`` beats."""
    name = str(rng.choice(formation_names(n)))
    place = slots(n, name)[rng.permutation(n)]
    # the clip need not begin with a section: a dance cut anywhere looks the same
    lead = int(rng.integers(0, 2)) * PHRASE
    score = Score(moves=[[] for _ in range(n)], centre=np.zeros((n, 0, 2)))
    score.formations.append((0, name, place.copy()))
    while score.centre.shape[1] < num_beats:
        _hold(score, place, 2 * PHRASE - lead, rng)
        lead = 0
        name = str(rng.choice([x for x in formation_names(n) if x != name]))
        stop, bulge = plan_transition(place, slots(n, name), rng, swap=bool(rng.random() < 0.5))
        _travel(score, curved_paths(place, stop, bulge, PHRASE + 1)[:, 1:])
        place = stop
        score.formations.append((score.centre.shape[1], name, place.copy()))
    return score


def _hold(score: Score, place: np.ndarray, beats: int, rng: np.random.Generator) -> None:
    n = len(place)
    relation = str(rng.choice(RELATIONS)) if n > 1 else "unison"
    phrases = [MOVES[i] for i in rng.choice(len(MOVES), beats // PHRASE, replace=False)]
    for i in range(n):
        delay = 2 * (i % 3) if relation == "canon" else 0
        flip = relation == "mirror" and place[i, 0] > place[:, 0].mean()
        for k in range(beats):
            move = phrases[max(k - delay, 0) // PHRASE]
            # before a canon voice enters it grooves on the spot
            score.moves[i].append((MOVES[0], k, flip) if k < delay else (move, k - delay, flip))
    hold = np.repeat(place[:, None], beats, axis=1)
    score.centre = np.concatenate([score.centre, hold], axis=1)


def _travel(score: Score, way: np.ndarray) -> None:
    for i in range(len(way)):
        score.moves[i].extend((TRAVEL, k, False) for k in range(PHRASE))
    score.centre = np.concatenate([score.centre, way], axis=1)


def footsteps(score: Score, dancer: int) -> dict[str, list[Step]]:
    """All footfalls of one dancer, by foot, each list beginning with where the foot starts."""
    centre = score.centre[dancer]
    steps = {s: [Step(-1.0, centre[0] + _HOME[s], _TOE_OUT[s])] for s in "LR"}
    for k, (move, within, flip) in enumerate(score.moves[dancer]):
        event = FOOTWORK[move.feet][within % PHRASE]
        if event is None or k == 0:
            continue
        foot, dx, dz = event
        if flip:
            foot, dx = "LR"[foot == "L"], -dx
        ahead = min(k + 1, len(centre) - 1)  # a walking foot lands ahead of the body
        place = 0.5 * (centre[k] + centre[ahead]) + _HOME[foot] + [dx, dz]
        steps[foot].append(Step(float(k), place, _TOE_OUT[foot], LIFT.get(move.feet, 0.09)))
    _come_home(score, dancer, steps)
    return steps


def _come_home(score: Score, dancer: int, steps: dict[str, list[Step]]) -> None:
    """Add a step wherever a foot was left behind by a move that ended early (canon) or a travel."""
    moves = score.moves[dancer]
    for k in range(1, len(moves)):
        if moves[k][0] is moves[k - 1][0] and moves[k][1] == moves[k - 1][1] + 1:
            continue
        for turn, foot in enumerate("LR"):
            beat = k + turn
            if beat >= len(moves):
                continue
            taken = [i for i, s in enumerate(steps[foot]) if abs(s.beat - beat) < 0.5]
            before = [i for i, s in enumerate(steps[foot]) if s.beat < beat]
            home = score.centre[dancer][min(beat, len(moves) - 1)] + _HOME[foot]
            if not taken and np.linalg.norm(steps[foot][before[-1]].place - home) > 0.05:
                steps[foot].insert(before[-1] + 1, Step(float(beat), home, _TOE_OUT[foot]))
