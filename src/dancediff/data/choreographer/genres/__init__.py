"""The ten genres of the choreographer; one module writes down one genre."""

import numpy as np

from dancediff.data.choreographer.genres.bollywood import BOLLYWOOD
from dancediff.data.choreographer.genres.contemporary import CONTEMPORARY
from dancediff.data.choreographer.genres.hiphop import HIPHOP
from dancediff.data.choreographer.genres.house import HOUSE
from dancediff.data.choreographer.genres.jazz import JAZZ
from dancediff.data.choreographer.genres.kpop import KPOP
from dancediff.data.choreographer.genres.locking import LOCKING
from dancediff.data.choreographer.genres.popping import POPPING
from dancediff.data.choreographer.genres.salsa import SALSA
from dancediff.data.choreographer.genres.waacking import WAACKING
from dancediff.data.choreographer.moves import Genre

GENRES: dict[str, Genre] = {
    genre.name: genre
    for genre in (
        HIPHOP, POPPING, LOCKING, HOUSE, WAACKING, JAZZ, SALSA, CONTEMPORARY, BOLLYWOOD, KPOP,
    )
}  # fmt: skip


def draw_genre(name: str | None, tempo: float, rng: np.random.Generator) -> Genre:
    """The named genre, or one of those that suit a tempo (beats a minute).

    Raises: ValueError naming the genre and those there are.

    >>> draw_genre("salsa", 60, np.random.default_rng(0)).name
    'salsa'
    """
    if name is not None:
        if name not in GENRES:
            raise ValueError(f"genre={name!r} is unknown; choose one of {', '.join(GENRES)}")
        return GENRES[name]
    misfit = {g.name: max(g.tempo[0] - tempo, tempo - g.tempo[1], 0) for g in GENRES.values()}
    best = min(misfit.values())
    fitting = [g for g in GENRES.values() if misfit[g.name] <= best]
    return fitting[int(rng.integers(len(fitting)))]
