"""What commands check before they work, and how they hand over files and words.

Read first: docs/export.md.
"""

import contextlib
import importlib.util
import json
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from tqdm.auto import tqdm

from dancediff.atomic import writing

FORMATS = ("npz", "mp4", "png", "html", "glb", "bvh", "smpl")
USUAL = ("npz", "mp4", "png")
EXTRAS = {"av": "video", "pygltflib": "gltf", "pythreejs": "notebooks", "ipywidgets": "notebooks"}
ONE_DANCER = re.compile(r"dance(?:\.\d+)?(\.bvh|\.smpl\.npz)")  # of a group one file each
HIDDEN = ".dancediff-"  # how folders begin that are being written
A_DAY = 24 * 3600.0
_NEEDS = {"mp4": "av", "glb": "pygltflib"}


def song_named(name: str):
    """A `Music` from a sound file, or the song of the package by either of its names."""
    from dancediff import hub

    return hub.packaged_song() if name in ("packaged", hub.SONG) else hub.Music.load(name)


def tell(as_json: bool, facts: dict, lines: list[str]) -> None:
    """Print a result, for programs or for people."""
    print(json.dumps(facts, default=str) if as_json else "\n".join(lines))


def check_formats(text: str) -> list[str]:
    """Split ``--formats`` and refuse what cannot be written, before any work is done."""
    formats = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    for name in formats or [text]:
        if name not in FORMATS:
            raise ValueError(f"--formats {text!r}: {name!r} is not one of {','.join(FORMATS)}")
    for name in formats:
        module = _NEEDS.get(name)
        if module and importlib.util.find_spec(module) is None:
            others = ",".join(other for other in USUAL if other != name)
            raise RuntimeError(
                f"--formats {text!r}: {name} needs {module}; pip install "
                f'"dancediff[{EXTRAS[module]}]", or choose --formats {others}'
            )
    return formats


def check_folder(folder: Path, name: str = "--out") -> None:
    """Refuse an output folder that cannot be one, before any work is done."""
    for part in (folder, *folder.parents):
        if part.exists():
            if not part.is_dir():
                raise ValueError(f"{name} {str(folder)!r}: {str(part)!r} is a file; name a folder")
            try:
                tempfile.TemporaryFile(dir=part).close()
            except OSError as err:
                raise ValueError(
                    f"{name} {str(folder)!r}: cannot write in {str(part)!r} ({err.strerror}); "
                    "name another folder"
                ) from err
            return


def check_targets(out: Path, formats: list[str]) -> None:
    """Refuse to write a file where a folder is."""
    for name in formats:
        suffix = file_of(name).removeprefix("dance")
        for target in (out / file_of(name), *out.glob(f"dance.*{suffix}")):
            if target.is_dir():
                raise ValueError(
                    f"--out {str(out)!r}: {str(target)!r} is a folder; remove it or name another "
                    "folder"
                )


def file_of(name: str) -> str:
    """The file of a format; bvh and smpl write one for each dancer of a group."""
    return "dance.smpl.npz" if name == "smpl" else f"dance.{name}"


def write_all(out: Path, write: Callable[[Path], object]) -> list[Path]:
    """Let ``write`` fill a hidden folder, then move all its files into place."""
    new = [part for part in (out, *out.parents) if not part.exists()]  # deepest first
    try:
        out.mkdir(parents=True, exist_ok=True)
        _remove_left_over(out)
        with tempfile.TemporaryDirectory(prefix=HIDDEN, dir=out) as folder:
            work = Path(folder)
            with writing(out):
                write(work)
            files = sorted(work.iterdir())  # a BVH of a group is a file for each dancer
            done = [file.replace(out / file.name) for file in files]
            _remove_other_dancers(done)
            return done
    except BaseException:
        for part in new:
            with contextlib.suppress(OSError):  # not there yet, or somebody else wrote into it
                part.rmdir()
        raise


def _remove_other_dancers(files: list[Path]) -> None:
    """As `Motion.save` does, which saw only the hidden folder."""
    from dancediff import io

    for kind in {found[1] for file in files if (found := ONE_DANCER.fullmatch(file.name))}:
        io.remove_other_dancers(files[0].with_name(f"dance{kind}"), files)


def of_an_earlier_dance(out: Path, files: Iterable) -> list[str]:
    """A line that names files of an earlier dance in the same folder, if there are any."""
    new = {Path(file).name for file in files}
    suffixes = tuple(file_of(name).removeprefix("dance") for name in FORMATS)
    old = [
        path.name
        for path in sorted(out.glob("dance.*"))
        if path.name.endswith(suffixes) and path.name not in new
    ]
    return [f"  (of an earlier dance: {', '.join(old)})"] if old else []


def _remove_left_over(out: Path) -> None:
    """What killed programs were writing: hidden folders in which nothing happened for a day."""
    for folder in out.glob(f"{HIDDEN}*"):
        with contextlib.suppress(OSError):  # its owner has just finished
            last = max(path.stat().st_mtime for path in (folder, *folder.iterdir()))
            if time.time() - last > A_DAY:
                shutil.rmtree(folder, ignore_errors=True)


def save_dance(folder: Path, formats: list[str], dance, song, progress: bool = False) -> None:
    """A file of a dance for each format; a video takes longer than all others."""
    bar = tqdm(formats, unit="file", disable=not progress)
    for name in bar:
        bar.set_description(f"writing {name}")
        dance.save(folder / file_of(name), song=song)
