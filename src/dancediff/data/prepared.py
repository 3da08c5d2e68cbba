r"""`PreparedData`: a folder of prepared takes, its splits, and the takes themselves when asked for.

Read first: `dancediff.data.take` and `dancediff.data.prepare`, which writes the folder.

Files in the folder
    index.json            one line a take: origin, licence, split, size
    takes/<name>.npz      a take, see `dancediff.data.take_file`
    composed/<name>.npz   a take composed of others
    cache/                memory maps and features; may be deleted at any time
"""

import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from pathlib import Path

from dancediff.axes import FPS
from dancediff.data.take import SPLITS, DanceTake, check_words
from dancediff.data.take_file import read_take

FORMAT = "dancediff-prepared-1"
FOLDERS = ("takes", "composed")
PACKING = ".packing-"  # prefix of folders in cache/ in which maps are being written
AND = " + "  # between the groups of a take that was made from several
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]{0,150}")


@dataclass(frozen=True)
class Entry:
    """One line of the index; see `DanceTake` for the words."""

    name: str
    file: str
    kind: str
    music: str
    split: str
    group: str
    source: str
    licence: str
    dancers: int
    frames: int
    genre: str | None = None
    fps: float = FPS
    songs: int = 0  # to the same beats: the song itself, and others for augmentation
    made_by: str = ""
    loudness: float | None = None
    notes: dict = field(default_factory=dict)

    @property
    def groups(self) -> list[str]:
        """What must stay on the same side of a split."""
        return self.group.split(AND)


class PreparedData:
    """The takes of a prepared folder, in the order of their names. Dances are read when asked for.

    Nothing that belongs together may be on two sides of a split: takes of one group, or a composed
    take and the takes it was made from. That is checked here.

    Raises: ValueError naming the folder, the take and the fix.

    >>> PreparedData("nowhere")
    Traceback (most recent call last):
        ...
    ValueError: 'nowhere' is no folder of prepared data; make one with `dancediff prepare`
    """

    def __init__(self, folder):
        self.folder = Path(folder)
        index = read_index(self.folder)
        self.skipped: list[dict] = index.get("skipped", [])
        self.entries = [_entry(row, self.folder) for row in index["takes"]]
        self.by_name = {entry.name: entry for entry in self.entries}
        if len(self.by_name) < len(self.entries):
            raise ValueError(f"{self._index}: two takes have one name; prepare the folder anew")
        self._check_splits()

    @property
    def _index(self) -> str:
        return repr(str(self.folder / "index.json"))

    def _check_splits(self) -> None:
        side: dict[str, Entry] = {}
        for entry in self.entries:
            for group in entry.groups:
                other = side.setdefault(group, entry)
                if other.split != entry.split:
                    raise ValueError(
                        f"{self._index}: {other.name!r} is in {other.split} and {entry.name!r} in "
                        f"{entry.split}, but both belong to {group!r}; give them one split and "
                        "prepare the folder anew"
                    )

    def __len__(self) -> int:
        return len(self.entries)

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries)

    def split(self, name: str) -> list[Entry]:
        """The takes of "train", "val" or "test"; a split may be empty.

        Raises: ValueError for another name.
        """
        if name not in SPLITS:
            raise ValueError(f"split={name!r} is not one of {', '.join(SPLITS)}")
        return [entry for entry in self.entries if entry.split == name]

    def load(self, take: Entry | str) -> DanceTake:
        """Read one take, by name or entry.

        Raises: ValueError when there is no such take, or its file is missing or damaged.
        """
        name = take if isinstance(take, str) else take.name
        if name not in self.by_name:
            raise ValueError(f"{str(self.folder)!r} has no take {name!r}; see its index.json")
        path = self.folder / self.by_name[name].file
        if not path.is_file():
            raise ValueError(f"{str(path)!r} is missing; run `dancediff prepare` again")
        return read_take(path)


def is_prepared(folder: Path) -> bool:
    """Does the folder hold an index of ours, of whatever version? Others have an index.json too."""
    try:
        with (folder / "index.json").open("rb") as file:
            return (
                re.match(rb'\s*\{\s*"format":\s*"dancediff-prepared-', file.read(200)) is not None
            )
    except OSError:
        return False


def read_index(folder: Path) -> dict:
    """The content of a folder's index, its takes not checked yet.

    Raises: ValueError naming the folder or the file.
    """
    path = folder / "index.json"
    if not path.is_file():
        raise ValueError(
            f"{str(folder)!r} is no folder of prepared data; make one with `dancediff prepare`"
        )
    try:
        index = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as err:
        raise ValueError(f"{str(path)!r} cannot be read as JSON; prepare it anew: {err}") from err
    if not isinstance(index, dict) or index.get("format") != FORMAT:
        raise ValueError(f"{str(path)!r} is not of the format {FORMAT!r}; prepare it anew")
    skipped = index.get("skipped", [])
    if not isinstance(index.get("takes"), list) or not isinstance(skipped, list):
        raise ValueError(f"{str(path)!r} has no list of takes; prepare it anew")
    return index


def _entry(row, folder: Path) -> Entry:
    known = {f.name for f in fields(Entry)}
    try:
        entry = Entry(**{key: value for key, value in row.items() if key in known})
        _check(entry)
    except (AttributeError, TypeError, ValueError) as err:
        name = row.get("name") if isinstance(row, dict) else row
        where = str(folder / "index.json")
        raise ValueError(f"{where!r}, take {str(name)[:80]!r}: {err}; prepare it anew") from err
    return entry


def _check(entry: Entry) -> None:
    if not NAME.fullmatch(entry.name):
        raise ValueError("this is no name of a take")
    if entry.file not in [f"{folder}/{entry.name}.npz" for folder in FOLDERS]:
        raise ValueError(f"file {str(entry.file)[:80]!r} is not where takes are")
    check_words(entry)
    if not isinstance(entry.group, str) or not entry.group:
        raise ValueError("it has no group")
    if not (entry.loudness is None or math.isfinite(entry.loudness)):
        raise ValueError(f"loudness={entry.loudness!r} is no finite number")
    for key, least in (("dancers", 1), ("frames", 1), ("songs", 0)):
        value = getattr(entry, key)
        if type(value) is not int or value < least:
            raise ValueError(f"{key}={value!r} is no whole number from {least} on")
    if entry.fps != FPS:
        raise ValueError(f"fps={entry.fps!r} is not {FPS}")
