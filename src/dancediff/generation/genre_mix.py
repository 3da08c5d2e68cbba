"""Genres that are asked for: one, a mix of some, or none in particular."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from dancediff.genre import genre_for, genre_number, spelled

if TYPE_CHECKING:
    from torch import Tensor

ANY = "any"  # no genre in particular; a model learns it from windows without their genre
BY_TEMPO = "by tempo"  # of the song
Mix = str | dict[str, float]


def mix_of(asked: str | Mapping[str, float]) -> Mix:
    """A request in its one form: a name, or names with shares that add up to 1.

    A mix may be written as text, as on the command line.

    Raises: ValueError for shares that are no numbers of at least 0, or are all 0.

    >>> mix_of("salsa"), mix_of({"hiphop": 2, "house": 2}), mix_of("hiphop=0.75,house=0.25")
    ('salsa', {'hiphop': 0.5, 'house': 0.5}, {'hiphop': 0.75, 'house': 0.25})
    >>> mix_of({"jazz": 1, "house": 0}), mix_of("jazz,house")
    ('jazz', {'jazz': 0.5, 'house': 0.5})
    """
    text = f"genre={asked!r} must be a name, or names with shares such as {{'hiphop': 0.7, ...}}"
    if isinstance(asked, str):
        if "=" not in asked and "," not in asked:
            return asked
        pairs = [part.partition("=") for part in asked.split(",")]
        alone = "" if "=" in asked else 1
        asked = {name.strip(): share or alone for name, _, share in pairs}  # type: ignore[misc]
    if not isinstance(asked, Mapping):
        raise ValueError(text)
    try:
        shares = {str(name): float(share) for name, share in asked.items()}
    except (TypeError, ValueError):
        raise ValueError(text) from None
    total = sum(shares.values())
    if not all(0 <= share < math.inf for share in shares.values()) or not 0 < total < math.inf:
        raise ValueError(f"genre={asked!r} must have shares of at least 0, one of them above")
    kept = {name: share / total for name, share in shares.items() if share}
    return next(iter(kept)) if len(kept) == 1 else kept


def resolved_genre(asked: Mix | None, usual: Mix, model, song) -> Mix | None:
    """What a model dances: what is asked for, else what is usual; None if it knows no genre.

    By tempo a song that is still to be heard gets `ANY`, if the model knows that.

    Raises: ValueError naming the genre and those there are, or that the model knows none.
    """
    from dancediff.extensions.genre_condition import genre_condition_of, genres_of
    from dancediff.music.live_song import LiveSong

    genres = genres_of(model)
    if not genres:
        if asked in (None, ANY):
            return None
        raise ValueError(
            f"genre={asked!r} needs a model that knows genres; leave it out, or train one with the "
            "extension 'genre_condition'"
        )
    asked = usual if asked is None else asked
    if asked == BY_TEMPO:
        unheard = isinstance(song, LiveSong) and math.isnan(song.tempo)
        if unheard and genre_condition_of(model) is not None:
            return ANY
        return genre_for(song.tempo, genres)
    if asked == ANY:
        if genre_condition_of(model) is not None:
            return ANY
        raise ValueError(
            f"genre={asked!r} is for models that dance without a genre, too; this one needs one of "
            f"{', '.join(genres)}"
        )
    if isinstance(asked, str):
        asked = spelled(asked, genres)
    else:
        shares = dict.fromkeys((spelled(name, genres) for name in asked), 0.0)
        for name, share in asked.items():  # two spellings of a genre are one
            shares[spelled(name, genres)] += share
        asked = mix_of(shares)
    for name in (asked,) if isinstance(asked, str) else asked:
        genre_number(name, genres)
    return asked


def mix_weights(mix: Mix, genres: tuple[str, ...]) -> "Tensor":
    """Shares of a resolved mix in the order of a model's genres; of `ANY` zeros, (1, g).

    >>> mix_weights({"a": 0.25, "c": 0.75}, ("a", "b", "c")).tolist()
    [[0.25, 0.0, 0.75]]
    """
    import torch

    shares = {mix: 1.0} if isinstance(mix, str) else mix
    return torch.tensor([[shares.get(name, 0.0) for name in genres]])
