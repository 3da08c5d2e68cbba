"""Which dances are compared: those of two systems to one song.

Read first: `dancediff.motion.files`, which finds dances in folders.

A system is a folder of dances, as `dancediff generate` writes them, or a model. The first one is
compared with each of the others, as Lodge is with other methods in its user study.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from dancediff import hub
from dancediff.data.song_folder import songs_in
from dancediff.metrics.dances import find_dances, read_dance
from dancediff.motion.motion import Motion
from dancediff.music.song import Music


@dataclass(frozen=True)
class Pair:
    """Two dances to one song, as long as each other, and the systems that they are of."""

    song: Music
    dances: tuple[Motion, Motion]
    systems: tuple[str, str]


def songs_named(songs) -> dict[str, Music]:
    """Songs by name: of files, folders, `Music`, or "packaged" for the one of the package.

    Raises: ValueError naming a song that cannot be read, or two with one name.
    """
    found: dict[str, Music] = {}
    for one in [songs] if isinstance(songs, str | Path | Music) else songs:
        for song in _songs(one):
            if song.name in found:
                raise ValueError(
                    f"songs: two are called {song.name!r}, and a dance says its song by its name; "
                    "rename a file"
                )
            found[song.name] = song
    return found


def _songs(one) -> list[Music]:
    if isinstance(one, Music):
        return [one]
    if str(one) in ("packaged", hub.SONG):
        return [hub.packaged_song()]
    if Path(one).is_dir():
        return [Music.load(song.path) for song in songs_in(one)]
    return [Music.load(one)]


def pairs_of(
    systems: Sequence,
    songs: dict[str, Music],
    *,
    seconds: float | None = None,
    dancers: int | None = None,
    progress: bool = False,
) -> list[Pair]:
    """All pairs of a dance of the first system and one of another to the same song.

    ``seconds``: at most so much of each; ``dancers``: how many a model lets dance. Of several
    dances to one song the first is compared with the first, and so on.

    Raises: ValueError for ``seconds`` that are not above 0; for fewer than two systems, two with
    one name, one that is neither folder nor model; and for dances that do not fit: no song in
    common, a song whose sound is not given, another number of dancers or another frame rate.
    """
    if seconds is not None and not seconds > 0:
        raise ValueError(f"seconds={seconds} must be above 0, such as 20")
    if len(systems) < 2:
        raise ValueError(f"{len(systems)} systems are given; a comparison needs two or more")
    how = {"seconds": seconds, "dancers": dancers, "progress": progress}
    for system in systems:
        _is_model(system)  # refuses what is neither, before another one has danced for minutes
    names = _names(systems)
    all_dances = [_dances_of(system, songs, **how) for system in systems]
    pairs = []
    for name, dances in zip(names[1:], all_dances[1:], strict=True):
        common = sorted(all_dances[0].keys() & dances.keys())
        if not common:
            raise ValueError(
                f"{names[0]!r} and {name!r} have no song in common: {_some(all_dances[0])} against "
                f"{_some(dances)}; name dances, or their folders, after their songs"
            )
        for title in common:
            if title not in songs:
                raise ValueError(f"the sound of song {title!r} is not given; add its file to songs")
            for both in zip(all_dances[0][title], dances[title], strict=False):
                pairs.append(_pair(songs[title], both, (names[0], name), seconds))
    return pairs


def _names(systems: Sequence) -> list[str]:
    """Short names of the systems, or the whole ones where two would be the same."""
    short = [Path(system).name for system in systems]
    names = short if len({*short}) == len(short) else [str(system) for system in systems]
    if len({*names}) < len(names):
        raise ValueError(f"systems {', '.join(names)}: one is named twice")
    return names


def _dances_of(system, songs: dict, **how) -> dict[str, list[Motion]]:
    """The dances of a system by the names of their songs."""
    if _is_model(system):
        return _danced(system, songs, **how)
    found: dict[str, list[Motion]] = {}
    for source in find_dances(system):
        dance = read_dance(source)
        song = dance.motion.meta.get("song")
        found.setdefault(song if isinstance(song, str) else dance.name, []).append(dance.motion)
    return found


def _is_model(system) -> bool:
    """Whether it is a model, or else a folder of dances, or a ValueError."""
    if not isinstance(system, str | PathLike):
        kind = type(system).__name__
        raise ValueError(f"a system is a {kind}; give a folder of dances or the name of a model")
    if str(system) in hub.packaged_models() or (Path(system) / "config.json").is_file():
        return True
    if Path(system).exists():
        return False
    known = ", ".join(hub.packaged_models())
    raise ValueError(
        f"{str(system)!r} is neither a folder of dances nor a model; the packaged ones are {known}"
    )


def _danced(model, songs: dict, *, seconds, dancers, progress) -> dict[str, list[Motion]]:
    """What a model dances to each song, by its defaults."""
    if not songs:
        raise ValueError(f"model {str(model)!r} needs songs to dance to; name some as songs")
    pipeline = hub.load(model)
    knows = dancers is not None and "dancers" in pipeline.request.names()
    most = math.inf if seconds is None else seconds
    options = {"progress": progress} | ({"dancers": dancers} if knows else {})
    return {
        name: [pipeline.generate(song, seconds=min(most, song.duration), **options)]
        for name, song in songs.items()
    }


def _pair(song: Music, dances, systems: tuple[str, str], seconds: float | None) -> Pair:
    """Two dances, cut to the length that both have."""
    first, other = dances
    for what in ("num_dancers", "fps"):
        values = getattr(first, what), getattr(other, what)
        if values[0] != values[1]:
            raise ValueError(
                f"song {song.name!r}: {what}={values[0]} of {systems[0]!r} and {values[1]} of "
                f"{systems[1]!r}; raters would know them apart, so compare dances that are alike "
                "in it (dancers= says how many a model lets dance)"
            )
    length = min(first.duration, other.duration, song.duration, seconds or song.duration)
    frames = round(length * first.fps)
    return Pair(song, (first.frames(0, frames), other.frames(0, frames)), systems)


def _some(names) -> str:
    listed = sorted(names)
    return ", ".join(listed[:3]) + (", …" if len(listed) > 3 else "")
