"""The ten genres of the choreographer, each written down in a file of its name in this folder.

A file holds the fields of `dancediff.data.choreographer.moves.Genre`; its tempo is in
`dancediff.genre`.
"""

import tomllib
from pathlib import Path

import numpy as np

from dancediff.data.choreographer.moves import Genre, Groove, Move, Style
from dancediff.genre import TEMPOS, spelled


def read_genre(name: str) -> Genre:
    """The genre of a file.

    >>> read_genre("salsa").moves[0].name
    'basic'
    """
    tables = tomllib.loads((Path(__file__).parent / f"{name}.toml").read_text(encoding="utf-8"))
    moves, travel = (tuple(Move(**move) for move in tables[key]) for key in ("moves", "travel"))
    groove, style, rest = (
        Groove(**tables["groove"]),
        Style(**tables["style"]),
        Move(**tables["rest"]),
    )
    return Genre(name, TEMPOS[name], tables["energy"], groove, style, moves, travel, rest)


GENRES = {name: read_genre(name) for name in TEMPOS}


def draw_genre(name: str | None, tempo: float, rng: np.random.Generator) -> Genre:
    """The named genre, or one of those that suit a tempo (beats a minute).

    Raises: ValueError naming the genre and those there are.

    >>> draw_genre("Hip-Hop", 60, np.random.default_rng(0)).name
    'hiphop'
    """
    if name is not None:
        known = spelled(name, GENRES) if isinstance(name, str) else None
        if known not in GENRES:
            raise ValueError(f"genre={name!r} is unknown; choose one of {', '.join(GENRES)}")
        return GENRES[known]
    misfit = {g.name: max(g.tempo[0] - tempo, tempo - g.tempo[1], 0) for g in GENRES.values()}
    best = min(misfit.values())
    fitting = [g for g in GENRES.values() if misfit[g.name] <= best]
    return fitting[int(rng.integers(len(fitting)))]
