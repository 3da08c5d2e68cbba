"""Dances as files; the suffix of a path says which format.

Read first: docs/export.md · `dancediff.motion.files`.

| suffix | holds | read again |
| --- | --- | --- |
| ``.npz`` | all of a `Motion` | yes |
| ``.bvh``, ``.smpl.npz`` | one dancer a file, for motion capture programs and SMPL viewers | yes |
| ``.glb`` | bodies that move, for 3-D programs | yes, without contacts |
| ``.pkl``, ``.npy`` | what EDGE, TCDiff, GCD, Lodge and FineDance write; not written here | yes |
| ``.mp4``, ``.gif``, ``.png`` | pictures; a song is muxed into an .mp4 | no |
| ``.html`` | a page that plays the dance in 3-D, with its song, from disk | no |
"""

import re
import warnings
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path

from dancediff.data.folder.upright import standing
from dancediff.data.prepared import PreparedData, is_prepared
from dancediff.export.bvh import load_bvh, save_bvh
from dancediff.export.smpl import save_smpl
from dancediff.io.npz import check_finite, load_npz, save_npz
from dancediff.motion.files import Files, register
from dancediff.motion.motion import Motion
from dancediff.music.song import as_song

PER_DANCER: dict[str, Callable] = {".bvh": save_bvh, ".smpl.npz": save_smpl}
SUFFIXES = (".npz", ".mp4", ".gif", ".png", ".html", ".glb", *PER_DANCER)
READABLE = (".npz", ".glb", ".smpl.npz", ".bvh", ".pkl", ".npy")  # what keeps most comes first


def save(motion: Motion, path, song=None, *, body: str = "mannequin") -> Path:
    """Write a dance in the format of the suffix; see `dancediff.motion.motion.Motion.save`."""
    path = Path(path)
    kind = suffix_of(path)
    if kind not in SUFFIXES:
        raise ValueError(f"suffix {kind!r} of {path} is unknown; use {' '.join(SUFFIXES)}")
    if body != "mannequin" and kind != ".glb":
        raise ValueError(f"body={body!r} goes with .glb only, not with {path}; leave it out")
    check_finite(motion, path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write = _writer(kind, as_song(song), body)
    if kind not in PER_DANCER or motion.num_dancers == 1:
        write(motion, path)
        return path
    numbered = files_of(path, motion.num_dancers)
    for k, name in enumerate(numbered):
        write(motion.dancer(k), name)
    remove_other_dancers(path, numbered)
    return numbered[0]


def files_of(path: Path, dancers: int) -> list[Path]:
    """The files that `save` writes for so many dancers.

    >>> [file.name for file in files_of(Path("a.bvh"), 2)]
    ['a.1.bvh', 'a.2.bvh']
    """
    kind = suffix_of(path)
    if kind not in PER_DANCER or dancers == 1:
        return [path]
    stem = path.name.removesuffix(kind)
    digits = len(str(dancers))  # 01 ... 10: by name they lie in their order
    return [path.with_name(f"{stem}.{k + 1:0{digits}d}{kind}") for k in range(dancers)]


def replaced_by(path: Path, dancers: int) -> list[Path]:
    """The files that are lost when `save` writes so many dancers: overwritten or removed."""
    written = files_of(path, dancers)
    others = [] if written == [path] else _other_dancers(path, written)
    return [file for file in written if file.exists()] + others


def remove_other_dancers(path: Path, written: Collection[Path]) -> None:
    """Remove the files of another group, or of a solo, that `save` once wrote for this ``path``.

    Beside those ``written`` now they would count as dancers of the new dance.
    """
    for other in _other_dancers(path, written):
        other.unlink()


def _other_dancers(path: Path, written: Collection[Path]) -> list[Path]:
    kind = suffix_of(path)
    stem = path.name.removesuffix(kind)
    own = re.compile(rf"{re.escape(stem)}(\.\d+)?{re.escape(kind)}")
    return [
        other
        for other in (path.parent.iterdir() if path.parent.is_dir() else ())
        if own.fullmatch(other.name) and other not in written and other.is_file()
    ]


def load(path, *more) -> Motion:
    """Read a dance in a format that can be read; see `dancediff.motion.motion.Motion.load`."""
    motions = [_reader(Path(name))(Path(name)) for name in (path, *more)]
    return motions[0] if len(motions) == 1 else Motion.side_by_side(motions)


def dance_files(path) -> list[Path]:
    """The dances that a path means: a file itself, or all in a folder and the folders in it.

    Of a dance that is there in several formats (``dance.npz``, ``dance.glb``, ``dance.1.bvh``) the
    one that keeps most of it counts; of a group that is there only in files of one dancer each they
    count one by one, and a warning says so. A prepared folder has those of its index. Files and
    folders under a name with a dot in front are still being written.

    Raises: ValueError naming a path that does not exist, is no dance, or holds none.
    """
    path, known = Path(path), " ".join(READABLE)
    if not path.exists():
        raise ValueError(f"{str(path)!r} does not exist; name a dance or a folder of dances")
    if not path.is_dir():
        if _kind_read(path) not in READABLE:
            raise ValueError(
                f"{str(path)!r} is no dance that can be read; name a file in {known}, or read "
                "others by `dancediff prepare folder`"
            )
        if not path.is_file():  # a pipe would be waited for without end
            raise ValueError(f"{str(path)!r} is no regular file; save the dance to one first")
        return [path]
    if is_prepared(path):
        found = [path / entry.file for entry in PreparedData(path)]
    else:
        found = _best_files(path)
    if not found:
        raise ValueError(f"{str(path)!r} holds no dance ({known}); name a folder that does")
    return found


def _best_files(folder: Path) -> list[Path]:
    dances: dict[Path, dict[int, list[Path]]] = {}
    for path in sorted(folder.rglob("*")):
        hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
        kind = _kind_read(path)
        if kind in READABLE and not hidden and path.is_file():
            name = path.name[: -len(kind)]
            if kind in PER_DANCER:
                name = re.sub(r"\.\d+$", "", name)
            formats = dances.setdefault(path.with_name(name), {})
            formats.setdefault(READABLE.index(kind), []).append(path)
    kept = [formats[min(formats)] for formats in dances.values()]
    for dancers in kept:
        if len(dancers) > 1:
            names = ", ".join(path.name for path in dancers)
            warnings.warn(
                f"{names} in {str(dancers[0].parent)!r} count as solos, one by one; to have the "
                f"group, join them by `dancediff convert {names.replace(',', '')} dance.npz`",
                stacklevel=3,
            )
    return [path for dancers in kept for path in dancers]


def _kind_read(path: Path) -> str:
    """The suffix of a file that is there, in small letters: other programs write ``.BVH`` too."""
    return suffix_of(Path(path.name.lower()))


def suffix_of(path: Path) -> str:
    """``.smpl.npz`` for SMPL arrays, else what pathlib says.

    >>> suffix_of(Path("dance.smpl.npz")), suffix_of(Path("my.dance.npz"))
    ('.smpl.npz', '.npz')
    """
    two = "".join(path.suffixes[-2:])
    return two if two in SUFFIXES else path.suffix


def _writer(kind: str, song, body: str) -> Callable[[Motion, Path], object]:
    """What writes a format; only that one's libraries are imported."""
    if kind == ".npz":
        return save_npz
    if kind in PER_DANCER:
        return PER_DANCER[kind]
    if kind == ".glb":
        from dancediff.export.gltf import save_glb

        return partial(save_glb, body=body)
    if kind == ".png":
        from dancediff.viz.plots import save_filmstrip

        return partial(save_filmstrip, song=song)
    if kind == ".html":
        from dancediff.viz.player import save_player

        return partial(save_player, song=song)
    from dancediff.viz.video import save_video

    return partial(save_video, song=song)


def _reader(path: Path) -> Callable[[Path], Motion]:
    """What reads a format; whatever has another suffix is tried as an .npz."""
    kind = path.suffix.lower()
    if kind in (".pkl", ".npy"):
        return _load_arrays
    if kind == ".bvh":
        return load_bvh
    if kind == ".glb":
        from dancediff.export.gltf import load_glb

        return load_glb
    return load_npz


def _load_arrays(path: Path) -> Motion:
    """A dance that another paper's code wrote, turned upright; 30 frames a second if it tells none.

    The files of AIST++ tell none either: they have 60.
    """
    try:
        return standing(path).motion
    except FileNotFoundError:
        raise
    except (OSError, ValueError) as err:
        raise ValueError(
            f"{path} is no dance of EDGE, TCDiff, GCD, Lodge or FineDance: {err}"
        ) from err


def _picture(motion: Motion) -> str:
    from dancediff.viz.still import dance_html

    return dance_html(motion)


register(Files(save, load, _picture, dance_files))
