r"""How the dancers of a group relate in a phrase: who does what, when, on which side, how low.

unison  all the same
mirror  the right half is the mirror image of the left one
pairs   neighbours are mirror images
canon   each enters two beats after the neighbour
ripple  each one beat after the neighbour
call    half the group dances half a phrase, and rests while the other half answers
duets   two parts of the group dance different phrases, and exchange them
levels  every other dancer is low
solo    who stands in front dances, the others wait
"""

from dataclasses import dataclass

import numpy as np

ODDS = {  # of relations in the phrases of a section
    "verse": {
        "unison": 2, "canon": 2, "ripple": 2, "call": 2, "mirror": 1, "pairs": 1, "duets": 3,
        "levels": 2, "solo": 1,
    },
    "chorus": {"unison": 3, "mirror": 2, "pairs": 2, "ripple": 1, "levels": 2, "duets": 3},
    "bridge": {"solo": 3, "duets": 3, "canon": 2, "call": 2, "levels": 1},
}  # fmt: skip
_OTHER = {"unison": 3, "mirror": 1, "pairs": 1, "ripple": 1, "levels": 1}
WAITING = ("canon", "call", "solo")  # in which some do little for a while
LOW = 12.0  # centimetres that a low dancer is below the others


@dataclass(frozen=True)
class Role:
    """How one dancer takes a phrase.

    delay  beats later than the others
    waits  does not dance at all
    half   dances only the first (0) or the second (1) half of the phrase
    flip   on the other side
    other  dances the second move of the phrase
    low    centimetres below the others
    """

    delay: int = 0
    waits: bool = False
    half: int | None = None
    flip: bool = False
    other: bool = False
    low: float = 0.0


def draw_relations(label: str, n: int, rng: np.random.Generator) -> tuple[str, str]:
    """Two different relations that the phrases of a label take turns in; one dancer has none."""
    odds = dict(ODDS.get(label, _OTHER))
    first = _drawn(odds, rng)
    if n == 1:
        return "unison", "unison"
    del odds[first]
    return first, _drawn(odds, rng)


def _drawn(odds: dict[str, int], rng: np.random.Generator) -> str:
    return str(rng.choice(list(odds), p=np.array(list(odds.values())) / sum(odds.values())))


def role_of(relation: str, place: np.ndarray, dancer: int, phrase: int) -> Role:
    """What a dancer does in phrase number ``phrase`` of a section; place (n, 2) metres.

    >>> place = np.array([[1.0, 0.0], [-1.0, 0.3]])
    >>> role_of("canon", place, 0, 0).delay, role_of("solo", place, 0, 0).waits
    (2, True)
    """
    rank = int((place[:, 0] < place[dancer, 0]).sum())
    odd = (rank + phrase) % 2
    roles = {
        "mirror": Role(flip=right(place)[dancer]),
        "pairs": Role(flip=rank % 2 == 1),
        "canon": Role(delay=2 * (rank % 3)),
        "ripple": Role(delay=rank),
        "call": Role(half=odd),
        "duets": Role(other=(rank >= len(place) // 2) ^ (phrase % 2 == 1)),
        "levels": Role(low=LOW * odd),
        "solo": Role(waits=bool(dancer != place[:, 1].argmax())),
    }
    return roles.get(relation, Role())


def right(place: np.ndarray) -> list[bool]:
    """Who stands on the side of larger x, of dancers at (n, 2) metres.

    >>> right(np.array([[1.0, 0.0], [-1.0, 0.3]]))
    [True, False]
    """
    return (place[:, 0] > place[:, 0].mean()).tolist()
