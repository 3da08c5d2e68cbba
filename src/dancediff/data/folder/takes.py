r"""Which files of a folder are one take: by their names, or by ``takes.toml`` beside them.

Read first: docs/your_own.md.

    [[take]]                                 # all but files may be left out
    files = ["duo/anna.bvh", "duo/ben.bvh"]  # of one take, relative to the folder
    name = "duo"
    song = "songs/duo.ogg"
    genre, split, kind, source, licence      # words; kind: real, composed or synthetic
    fps, up, unit, rest, joints              # see `dancediff.data.folder.posture.Given`

A song is else the sound file of the take's name, beside it or in a folder ``songs`` or ``music``.
"""

import re
import tomllib
import warnings
from collections import Counter
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

from dancediff.data.folder.posture import Given
from dancediff.data.formats import find_song
from dancediff.data.names import plain_name, short_hash
from dancediff.data.prepared import is_prepared
from dancediff.data.take import KINDS, SPLITS

MANIFEST = "takes.toml"
SUFFIXES = (".bvh", ".npz", ".npy", ".pkl", ".glb", ".gltf")
BEST = (".npz", ".glb", ".gltf", ".smpl.npz", ".bvh", ".pkl", ".npy")  # what keeps most comes first
_GIVEN = tuple(f.name for f in fields(Given))
_WORDS = ("name", "song", "genre", "split", "kind", "source", "licence")


@dataclass(frozen=True)
class TakePlan:
    """A take that is to be made: its files, and what is known of it."""

    name: str
    files: tuple[Path, ...]
    given: Given = field(default_factory=Given)
    song: Path | None = None
    genre: str | None = None
    split: str | None = None
    kind: str | None = None  # of the motion; None: as the files say, else real
    source: str = ""
    licence: str = ""
    labels: tuple[str, ...] = field(default=())  # the files as seen from the folder


def takes_in(
    src, *, group: str | None = None, given: Given | None = None, leave_out=None
) -> list[TakePlan]:
    """The takes of a folder, sorted by name.

    ``group`` tells how files of one take are named, such as "{take}_{dancer}"; without it every
    file that ``takes.toml`` does not name is a take. Of a dance that lies there in several formats
    the one that keeps most is taken, and a warning names the others. ``given`` holds for all of
    them. What lies in a prepared folder, or in the folder ``leave_out`` within ``src``, is no
    motion to prepare. Where two takes would have one name, or it is not ASCII, six letters are
    added to it, but not where a table writes it as it can stay.

    Raises: ValueError naming the folder, the file or the entry that is wrong.
    """
    src = Path(src)
    paths = _motion_files(src, leave_out)
    if not paths:
        raise ValueError(f"{str(src)!r} holds no {', '.join(SUFFIXES)} file, nor do its folders")
    given = given or Given()
    rows = _rows(src)
    planned = [_planned(row, k, src, given) for k, row in enumerate(rows, 1)]
    files = {file for plan in planned for file in plan.files}
    found = _found([path for path in paths if path not in files], src, group, given)
    labelled = [
        replace(plan, labels=tuple(file.relative_to(src).as_posix() for file in plan.files))
        for plan in [*planned, *found]
    ]
    tables = [*rows, *({} for _ in found)]
    names = [row.get("name", plan.labels[0]) for row, plan in zip(tables, labelled, strict=True)]
    return sorted(_apart(labelled, names), key=lambda plan: plan.name)


def _found(paths: list[Path], src: Path, group: str | None, given: Given) -> list[TakePlan]:
    """Takes of the files that no table names."""
    pattern = None if group is None else _pattern(group)
    rows: dict[tuple[str, ...], list[Path]] = {}  # folders and name
    alone = []  # names that the pattern does not fit
    for path in _one_format(paths):
        stem = path.name.removesuffix(_kind(path))
        match = None if pattern is None else pattern.fullmatch(stem)
        if pattern is not None and match is None:
            alone.append(path.relative_to(src).as_posix())
        short = match["take"] if match else stem
        rows.setdefault((*path.relative_to(src).parts[:-1], short), []).append(path)
    if alone:
        names = ", ".join(alone[:5]) + (f" and {len(alone) - 5} more" if len(alone) > 5 else "")
        text = f"group={group!r} does not fit {names}; each file is a take of its own"
        warnings.warn(text, stacklevel=3)
    plans = []
    for (*folders, short), files in rows.items():
        name = "_".join([*folders, short])
        song = _song(src, files[0], [short, name])
        plans.append(TakePlan(plain_name(name), tuple(files), given, song))
    return plans


def _kind(path: Path) -> str:
    """The end of its name that says the format, as it is written there."""
    ends = sorted(BEST, key=len, reverse=True)
    end = next(one for one in ends if path.name.lower().endswith(one))
    return path.name[-len(end) :]


def _one_format(paths: list[Path]) -> list[Path]:
    """Of every dance the files of one format: ``dance.npz`` and ``dance.1.bvh`` are one dance."""
    dances: dict[Path, dict[int, list[Path]]] = {}
    for path in paths:
        kind = _kind(path)
        name = path.name.removesuffix(kind)
        if kind.lower() in (".bvh", ".smpl.npz"):  # of a group one file each
            name = re.sub(r"\.\d+$", "", name)
        formats = dances.setdefault(path.with_name(name), {})
        formats.setdefault(BEST.index(kind.lower()), []).append(path)
    kept = [path for formats in dances.values() for path in formats[min(formats)]]
    if others := sorted({path.name for path in paths} - {path.name for path in kept}):
        warnings.warn(f"the same dances in other formats: {', '.join(others)}", stacklevel=3)
    return sorted(kept)


def _apart(plans: list[TakePlan], written: list[str]) -> list[TakePlan]:
    """The takes with names that differ; those that can stay as the user wrote them do.

    ``written`` are the names in the table, and where it tells none the file's.
    """
    times = Counter(plan.name for plan in plans)
    return [
        plan
        if plan.name == text or (times[plan.name] == 1 and text.isascii())
        else replace(plan, name=f"{plan.name}_{short_hash(text)}")
        for plan, text in zip(plans, written, strict=True)
    ]


def _motion_files(src: Path, leave_out) -> list[Path]:
    prepared = {path.parent for path in src.rglob("index.json") if is_prepared(path.parent)}
    if leave_out is not None:
        made, above = Path(leave_out).resolve(), src.resolve()
        if above in made.parents:
            prepared.add(src / made.relative_to(above))
    return [
        path
        for path in sorted(src.rglob("*"))
        if path.suffix.lower() in SUFFIXES
        and not any(part.startswith(".") for part in path.relative_to(src).parts)
        and not prepared.intersection(path.parents)
        and path.is_file()
    ]


def _pattern(group: str) -> re.Pattern:
    r"""What matches names of files of a group.

    >>> _pattern("{take}_{dancer}").fullmatch("my_waltz_Anne-José")["take"]
    'my_waltz'
    """
    if group.count("{take}") != 1 or group.count("{dancer}") != 1:
        raise ValueError(f'group={group!r} must name both, such as "{{take}}_{{dancer}}"')
    text = re.escape(group)
    text = text.replace(r"\{take\}", "(?P<take>.+)")
    # letters of any alphabet; a hyphen within a name, unless the pattern has hyphens of its own
    word = r"[A-Za-z0-9\u0080-\U0010ffff]+"
    dancer = word if "-" in group else f"{word}(?:-{word})*"
    return re.compile(text.replace(r"\{dancer\}", f"(?P<dancer>{dancer})"))


def _song(src: Path, file: Path, names: list[str]) -> Path | None:
    folders = [file.parent, *(src / place for place in ("songs", "music")), src]
    return find_song(folders, [*names, file.stem])


def _rows(src: Path) -> list[dict]:
    path = src / MANIFEST
    if not path.is_file():
        return []
    try:
        rows = tomllib.loads(path.read_text(encoding="utf-8-sig"))["take"]
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise TypeError("take is no table")
    except (OSError, ValueError, KeyError, TypeError) as err:
        raise ValueError(f"{str(path)!r} must hold [[take]] tables with files: {err}") from err
    return rows


def _planned(row: dict, number: int, src: Path, given: Given) -> TakePlan:
    where = f"{str(src / MANIFEST)!r}, take {number}"
    known = ("files", *_WORDS, *_GIVEN)
    if wrong := [key for key in row if key not in known]:
        raise ValueError(f"{where}: {wrong[0]!r} is unknown; use {', '.join(known)}")
    names = row.get("files")
    if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
        raise ValueError(f"{where}: files={names!r} must be a list of files")
    for file in names:
        if Path(file).is_absolute():
            raise ValueError(f"{where}: {file!r} must be relative to the folder")
        if Path(file).suffix.lower() not in SUFFIXES:
            raise ValueError(f"{where}: {file!r} is no {', '.join(SUFFIXES)}; convert it to one")
    if odd := [key for key in _WORDS if not isinstance(row.get(key, ""), str)]:
        raise ValueError(f"{where}: {odd[0]}={row[odd[0]]!r} must be text")
    files, song = [src / name for name in names], row.get("song")
    for file in [*files, *([src / song] if song else [])]:
        if not file.is_file():
            raise ValueError(f"{where}: {str(file)!r} is not there")
    if row.get("split", "train") not in SPLITS:
        raise ValueError(f"{where}: split={row['split']!r} is not one of {', '.join(SPLITS)}")
    if row.get("kind", "real") not in KINDS:
        raise ValueError(f"{where}: kind={row['kind']!r} is not one of {', '.join(KINDS)}")
    name = row.get("name", "_".join(Path(names[0]).with_suffix("").parts))
    try:
        given = replace(given, **{key: row[key] for key in _GIVEN if key in row})
    except (TypeError, ValueError) as err:
        raise ValueError(f"{where}: {err}") from err
    words = {key: row[key] for key in ("genre", "split", "kind", "source", "licence") if key in row}
    song = src / song if song else _song(src, files[0], [name])
    return TakePlan(plain_name(name), tuple(files), given, song, **words)
