"""Genres: their names, in the order of the numbers that models know them by, and their tempos.

The file is not called ``genres``, because `dancediff.genres` is the function `genres`.
"""

import json
import math
import re
from collections.abc import Iterable
from pathlib import Path

TEMPOS = {  # beats a minute, slowest and fastest; the choreographer's genres
    "hiphop": (82, 112),
    "popping": (88, 118),
    "locking": (98, 122),
    "house": (112, 132),
    "waacking": (112, 130),
    "jazz": (100, 142),
    "salsa": (84, 116),
    "contemporary": (60, 108),
    "bollywood": (88, 128),
    "kpop": (98, 138),
}
CAPTURED = ("indian", "captured_salsa")  # danced by people, so that none is fallen into by chance
GENRES = (*TEMPOS, *CAPTURED)
FINEDANCE = (  # those of the FineDance data set, in the order of Lodge's genre ids 0 to 15
    "Breaking", "Popping", "Locking", "Hiphop", "Urban", "Jazz", "Dai", "Wei", "Miao", "HanTang",
    "ShenYun", "Kun", "DunHuang", "Korean", "Choreography", "Chinese",
)  # fmt: skip


def genres() -> list[str]:
    """Names of the genres that the packaged Lodge model knows.

    >>> genres()[:3]
    ['hiphop', 'popping', 'locking']
    """
    config = Path(__file__).parent / "assets" / "models" / "lodge" / "config.json"
    stored = json.loads(config.read_text(encoding="utf-8"))
    return list(stored["config"]["local_stage"]["genres"])


def genre_for(tempo: float, genres: tuple[str, ...]) -> str:
    """The genre whose usual tempos have their middle nearest, as a ratio, to the song's.

    Genres without a known tempo, such as captured ones, are chosen only if there is no other;
    without a beat (``tempo`` nan) it is the one for the slowest songs.

    >>> genre_for(125.0, GENRES), genre_for(80.0, GENRES), genre_for(float("nan"), GENRES)
    ('house', 'contemporary', 'contemporary')
    """
    known = [name for name in genres if name in TEMPOS]
    if not known:
        return genres[0]
    if math.isnan(tempo):
        return min(known, key=lambda name: TEMPOS[name])
    return min(known, key=lambda name: abs(math.log(tempo / (sum(TEMPOS[name]) / 2))))


def spelled(name: str, genres: Iterable[str]) -> str:
    """A genre's name as models know it: no matter its capitals, spaces and hyphens.

    >>> spelled("Hip-Hop", GENRES), spelled("captured salsa", GENRES), spelled("waltz", GENRES)
    ('hiphop', 'captured_salsa', 'waltz')
    """

    def plain(text: str) -> str:
        return re.sub(r"[\s_-]", "", text.casefold())

    return next((one for one in genres if plain(one) == plain(name)), name)


def genre_number(name: str, genres: tuple[str, ...]) -> int:
    """Number of a genre.

    Raises: ValueError naming the genre and those there are.

    >>> genre_number("salsa", ("hiphop", "salsa"))
    1
    """
    if name not in genres:
        raise ValueError(f"genre={name!r} is unknown; choose one of {', '.join(genres)}")
    return genres.index(name)
