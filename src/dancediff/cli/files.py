"""What commands check before they work, and how they hand over files and words."""

import contextlib
import importlib.util
import json
import tempfile
from pathlib import Path

FORMATS = ("npz", "mp4", "png")
EXTRAS = {"av": "video", "pythreejs": "notebooks", "ipywidgets": "notebooks"}


def tell(as_json: bool, facts: dict, lines: list[str]) -> None:
    """Print a result, for programs or for people."""
    print(json.dumps(facts, default=str) if as_json else "\n".join(lines))


def check_formats(text: str) -> list[str]:
    """Split ``--formats`` and refuse what cannot be written, before any work is done."""
    formats = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    for name in formats or [text]:
        if name not in FORMATS:
            raise ValueError(f"--formats {text!r}: {name!r} is not one of {','.join(FORMATS)}")
    if "mp4" in formats and importlib.util.find_spec("av") is None:
        raise RuntimeError(
            f'--formats {text!r}: mp4 needs PyAV; pip install "dancediff[{EXTRAS["av"]}]", '
            "or choose --formats npz,png"
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
        if (target := out / f"dance.{name}").is_dir():
            raise ValueError(
                f"--out {str(out)!r}: {str(target)!r} is a folder; remove it or name another folder"
            )


def write_all(out: Path, formats: list[str], dance, song) -> list[Path]:
    """Write every file in a hidden folder first, then move all of them into place."""
    new = [part for part in (out, *out.parents) if not part.exists()]  # deepest first
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".dancediff-", dir=out) as folder:
            work = Path(folder)
            for suffix in formats:
                dance.save(work / f"dance.{suffix}", song=song)
            return [(work / f"dance.{s}").replace(out / f"dance.{s}") for s in formats]
    except BaseException:
        for part in new:
            with contextlib.suppress(OSError):  # not there yet, or somebody else wrote into it
                part.rmdir()
        raise
