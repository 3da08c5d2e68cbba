"""Which songs are meant, and what is asked of each: a list, a folder, or a manifest.

Read first: `dancediff.cli.many_songs`, which dances to them.

Manifest
    A table with commas or semicolons. The column ``song`` names a sound file, relative to the
    table, or "packaged"; others are the options of `dancediff generate`, ``model``, and ``name``
    for the folder of the dance. An empty cell leaves what the command says.
"""

import csv
import io
import re
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from dancediff.cli.options import FIELDS, read_option
from dancediff.hub import SONG
from dancediff.music.sound_on_disk import SOUND_SUFFIXES

OTHERS = (".aif", ".aiff", ".m4a", ".aac", ".wma", ".opus")  # sounds that are not looked for
NAMED = 3  # of those that are left out
PACKAGED = ("packaged", SONG)


@dataclass(frozen=True)
class SongRow:
    """A dance that is wanted; ``name`` is that of its folder."""

    name: str
    song: str
    model: str
    options: dict = field(default_factory=dict)


def are_many(songs: Sequence[str]) -> bool:
    """Whether the words of a command mean more than a sound file.

    >>> are_many(["a.wav"]), are_many(["a.wav", "b.wav"]), are_many(["list.csv"])
    (False, True, True)
    """
    one = Path(songs[0])
    return len(songs) > 1 or one.suffix.lower() == ".csv" or (one.is_dir() and not _is_word(one))


def song_list(songs: Sequence[str], model: str, options: dict) -> list[SongRow]:
    """The dances that the words of a command ask for.

    Names are those of the files; where two would be the same, what differs is added. They do not
    depend on the order.

    Raises: ValueError naming the folder without songs, the line of a manifest with what is wrong
    in it, or two rows that are alike.
    """
    rows = []
    for word in songs:
        path = Path(word)
        if path.is_dir() and not _is_word(path):
            rows += [SongRow(name, str(file), model, options) for name, file in _in_folder(path)]
        elif path.suffix.lower() == ".csv":
            rows += _in_manifest(path, SongRow("", "", model, options))
        else:
            rows.append(SongRow(path.stem, word, model, options))
    rows = _with_names_of_their_own(rows)
    for name, count in Counter(row.name.casefold() for row in rows).items():
        if count > 1:
            raise ValueError(
                f"{count} dances would be called {name!r}; name each song once, or give a "
                "manifest with a column name"
            )
    return rows


def _is_word(path: Path) -> bool:
    return str(path) in PACKAGED


def _in_folder(folder: Path) -> list[tuple[str, Path]]:
    """Songs of a folder and the folders in it; hidden ones do not count.

    Warns: of sound files in other formats, which are left out.
    """
    found = [
        path.relative_to(folder)
        for path in sorted(folder.rglob("*"))
        if path.suffix.lower() in (*SOUND_SUFFIXES, *OTHERS) and path.is_file()
    ]
    found = [path for path in found if not any(part.startswith(".") for part in path.parts)]
    files = [path for path in found if path.suffix.lower() in SOUND_SUFFIXES]
    if left := [path.as_posix() for path in found if path not in files]:
        names = ", ".join(left[:NAMED]) + (" and so on" if len(left) > NAMED else "")
        warnings.warn(
            f"{str(folder)!r} holds sound files that are not read: {len(left)} ({names}); convert "
            "them to wav, flac, ogg or mp3",
            stacklevel=2,
        )
    if not files:
        raise ValueError(f"{str(folder)!r} holds no wav, flac, ogg or mp3 file, nor do its folders")
    return [(path.with_suffix("").as_posix(), folder / path) for path in files]


def _in_manifest(path: Path, usual: SongRow) -> list[SongRow]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ValueError(f"{str(path)!r} does not exist; name a manifest or songs") from None
    except UnicodeDecodeError:
        raise ValueError(f"{str(path)!r} is no text in UTF-8; save the table as such") from None
    head = text.partition("\n")[0]
    lines = io.StringIO(text, newline="")
    table = csv.DictReader(lines, delimiter=";" if head.count(";") > head.count(",") else ",")
    columns = [name.strip().replace("-", "_") for name in table.fieldnames or ()]
    allowed = ("song", "name", "model", *FIELDS)
    if "song" not in columns:
        raise ValueError(f"{str(path)!r} has no column song; its first line names the columns")
    for name in columns:
        if name not in allowed or columns.count(name) > 1:
            raise ValueError(
                f"{str(path)!r}: column {name!r} is {'double' if name in allowed else 'unknown'}; "
                f"choose from {', '.join(allowed)}"
            )
    table.fieldnames = columns
    rows = []
    for cells in table:
        try:
            rows.append(_row(path.parent, cells, usual))
        except ValueError as err:
            raise ValueError(f"{str(path)!r}, line {table.line_num}: {err}") from None
    if not rows:
        raise ValueError(f"{str(path)!r} names no song; give it a row a dance")
    return rows


def _row(folder: Path, cells: dict, usual: SongRow) -> SongRow:
    if None in cells or None in cells.values():
        raise ValueError("it has more or fewer cells than the first line has columns")
    given = {key: text.strip() for key, text in cells.items() if text.strip()}
    song = given.pop("song", "")
    if not song:
        raise ValueError("the cell of song is empty")
    name, model = given.pop("name", ""), given.pop("model", usual.model)
    if name and not all(re.fullmatch(r"[^.\s\\:][^\\:]*", part) for part in name.split("/")):
        raise ValueError(f"name {name!r} is no name for a folder below OUT")
    options = usual.options | {key: read_option(key, text) for key, text in given.items()}
    if (folder / model / "config.json").is_file():
        model = str(folder / model)
    path = song if song in PACKAGED else str(folder / song)
    # one that was given stays as it is: it begins with a slash until all have names
    return SongRow(f"/{name}" if name else Path(song).stem, path, model, options)


def _with_names_of_their_own(rows: list[SongRow]) -> list[SongRow]:
    """Names that two or more share are told apart by their songs, and by their options."""
    alike: dict[str, list[SongRow]] = {}
    for row in rows:
        alike.setdefault(row.name.casefold(), []).append(row)
    return [_told_apart(row, alike[row.name.casefold()]) for row in rows]


def _told_apart(row: SongRow, alike: list[SongRow]) -> SongRow:
    """With those options in its name in which it differs from the others.

    >>> rows = [SongRow("a", "a.wav", "m", {"seed": seed}) for seed in (1, 2)]
    >>> _told_apart(rows[0], rows).name
    'a_seed1'
    """
    if row.name.startswith("/"):
        return replace(row, name=row.name[1:])
    name = row.name
    if len(alike) == 1:
        return row
    if len({one.song for one in alike}) > 1:
        suffixes = {Path(one.song).suffix for one in alike}
        folder = f"_{Path(row.song).absolute().parent.name}"
        name += Path(row.song).suffix if len(suffixes) == len(alike) else _word(folder)
    if len({one.model for one in alike}) > 1:
        name += f"_{_word(Path(row.model).name)}"
    for key in FIELDS:
        if len({one.options.get(key) for one in alike}) > 1 and key in row.options:
            value = row.options[key]
            text = "-".join(map(str, value)) if isinstance(value, tuple) else str(value)
            name += f"_{key}{_word(text)}"
    return replace(row, name=name)


def _word(text: str) -> str:
    """What can stand in a name of a file.

    >>> _word("songs/a b.wav")
    'songs-a-b.wav'
    """
    return re.sub(r"[^\w.+-]+", "-", text).strip("-")
