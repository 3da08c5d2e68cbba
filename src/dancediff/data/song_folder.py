r"""Songs in a folder, and what is known of each: title, author, licence.

Files
    songs.toml    [[song]] tables: file (relative to the folder), title, author, licence, package
    *copyright*   a text beside songs that no table names: it tells their licence
"""

import re
import tomllib
import unicodedata
from dataclasses import dataclass
from pathlib import Path

from dancediff.music.sound_on_disk import SOUND_SUFFIXES

MANIFEST = "songs.toml"
UNKNOWN = "unknown"
_FACTS = ("title", "author", "licence", "package")


@dataclass(frozen=True)
class SongFile:
    """A song on disk; ``title`` is also what holds several recordings of one song together."""

    path: Path
    title: str
    author: str = UNKNOWN
    licence: str = UNKNOWN
    package: str = ""

    @property
    def key(self) -> str:
        """The title in small letters and digits, of any alphabet.

        >>> SongFile(Path("a.ogg"), "The Sad Waltz (live)").key
        'the-sad-waltz-live'
        """
        title = unicodedata.normalize("NFKC", self.title).casefold()
        return re.sub(r"[\W_]+", "-", title).strip("-") or "song"

    @property
    def source(self) -> str:
        """Who made the song, in words."""
        package = f", Debian package {self.package}" if self.package else ""
        return f"song {self.title!r} by {self.author}{package}"


def songs_in(folder, *, licence: str | None = None) -> list[SongFile]:
    """The songs of a folder and its subfolders, sorted by path.

    ``licence`` is that of the songs of which nothing else is known.

    Raises: ValueError naming the folder when it holds no song, or the manifest when it cannot be
    read or names a file that is not there.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ValueError(f"src={str(folder)!r} is no folder; name the one that holds the songs")
    known = _manifest(folder)
    paths = sorted(p for p in folder.rglob("*") if _is_song(p, folder))
    if not paths:
        raise ValueError(f"{str(folder)!r} holds no wav, flac, ogg or mp3 file, nor do its folders")
    return [_song(path, known.get(path, {}), licence) for path in paths]


def _is_song(path: Path, folder: Path) -> bool:
    # macOS keeps "._a.mp3" beside "a.mp3", which is no sound
    hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
    return path.suffix.lower() in SOUND_SUFFIXES and not hidden and path.is_file()


def _song(path: Path, facts: dict, licence: str | None) -> SongFile:
    facts = {name: str(facts[name]) for name in _FACTS if name in facts}
    if "licence" not in facts:
        beside = sorted(p.name for p in path.parent.glob("*copyright*"))
        facts["licence"] = licence or (f"see {beside[0]}" if beside else UNKNOWN)
    return SongFile(path, **({"title": path.stem} | facts))


def _manifest(folder: Path) -> dict[Path, dict]:
    """What songs.toml says of each file."""
    path = folder / MANIFEST
    if not path.is_file():
        return {}
    try:
        rows = tomllib.loads(path.read_text(encoding="utf-8-sig"))["song"]
        known = {folder / row["file"]: row for row in rows}
    except (OSError, ValueError, KeyError, TypeError) as err:
        raise ValueError(
            f"{str(path)!r} must hold [[song]] tables, each with file = ...: {err}"
        ) from err
    for file in known:
        if not file.is_file():
            raise ValueError(f"{str(path)!r} names {str(file)!r}, which is not there")
    return known
