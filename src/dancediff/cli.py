"""The command line: ``dancediff generate``, ``train``, ``warm`` and ``doctor``.

Exit status: 0 done, 1 nothing could be done though the arguments were fine, 2 bad arguments or
input; the last line then names the value and the fix. torch is imported inside commands only.
"""

import contextlib
import importlib.metadata
import importlib.util
import io
import json
import operator
import os
import platform
import re
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

FORMATS = ("npz", "mp4", "png")
EXTRAS = {"av": "video", "pythreejs": "notebooks", "ipywidgets": "notebooks"}


@dataclass
class Generate:
    """Make a group dance to a song."""

    song: tyro.conf.Positional[str]
    """A wav, flac, ogg or mp3 file; 'packaged' for the song that comes with dancediff."""
    model: str = "tcdiffpp"
    """A packaged model's name, or a model folder."""
    dancers: int = 3
    """How many people dance."""
    seconds: float | None = None
    """How much of the song, from its start; default: all of it."""
    seed: int = 0
    """The same seed gives the same dance."""
    steps: int = 50
    """Denoising steps."""
    guidance: float = 2.0
    """How much the music matters: 0 not at all, 1 as learned, 2 exaggerated."""
    swap: tuple[int, ...] | None = None
    """Order at the end: the dancers (counted 0.. from the left at the start), left to right."""
    out: Path = Path("out")
    """Folder for the results."""
    formats: str = ",".join(FORMATS)
    """Which files to write, of npz, mp4, png."""
    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Check what is cheap to check, dance, then write all files or none."""
        from dancediff import hub

        formats = _check_formats(self.formats)
        _check_folder(self.out)
        _check_targets(self.out, formats)
        packaged = self.song in ("packaged", hub.SONG)
        song = hub.packaged_song() if packaged else hub.Music.load(self.song)
        model = hub.load(self.model)
        dance = model.generate(
            song,
            dancers=operator.index(self.dancers),
            seconds=self.seconds,
            seed=self.seed,
            steps=self.steps,
            guidance=self.guidance,
            swap=None if self.swap is None else list(self.swap),
            progress=not self.json,
        )
        files = _write_all(self.out, formats, dance, song)
        facts = {"files": files, "dancers": dance.num_dancers, "frames": dance.num_frames}
        who = "1 dancer" if dance.num_dancers == 1 else f"{dance.num_dancers} dancers"
        lines = [f"{who}, {dance.duration:.1f} s, to {song.name!r}:", *(f"  {f}" for f in files)]
        _tell(self.json, facts | dance.meta, lines)


@dataclass
class Train:
    """Train a model from a TOML config and write it as a model folder."""

    config: tyro.conf.Positional[Path]
    """For instance configs/tcdiffpp_small.toml."""
    out: Path = Path("runs/tcdiffpp")
    """Folder for checkpoint, losses and the model."""
    resume: bool = False
    """Go on from the checkpoint in the folder, if there is one."""
    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Train, then save the averaged model in OUT/model."""
        from dancediff import hub
        from dancediff.training.run import train_from_config

        _check_folder(self.out)
        model = train_from_config(self.config, self.out, resume=self.resume)
        settings = self.config.read_text(encoding="utf-8")
        card = f"Trained on synthetic dances with {self.config.name}:\n\n```toml\n{settings}```\n"
        folder = hub.save_model(model, self.out / "model", card=card)
        _tell(self.json, {"model": folder}, [f"model folder: {folder}"])


@dataclass
class Warm:
    """Compile librosa's inner loops once, so that the first dance does not wait for it."""

    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Compute the features of the packaged song."""
        from dancediff import hub

        song = hub.packaged_song()
        song.features()
        facts = {"song": song.name, "seconds": song.duration, "tempo": song.tempo}
        line = f"ready: {song.name!r}, {song.duration:.0f} s, {song.tempo:.0f} beats a minute"
        _tell(self.json, facts, [line])


@dataclass
class Doctor:
    """Say which versions are here, and what is missing."""

    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """One line a package."""
        versions: dict[str, str | None] = {"python": platform.python_version()}
        lines = [f"python {versions['python']} on {platform.system()} {platform.machine()}"]
        for name in ("dancediff", "torch", "numpy", "librosa", "soundfile", *EXTRAS):
            try:
                versions[name] = importlib.metadata.version(name)
                lines.append(f"{name} {versions[name]}")
            except importlib.metadata.PackageNotFoundError:
                versions[name] = None
                extra = f"[{EXTRAS[name]}]" if name in EXTRAS else ""
                lines.append(f'{name} is missing: pip install "dancediff{extra}"')
        _tell(self.json, versions, lines)


def _tell(as_json: bool, facts: dict, lines: list[str]) -> None:
    print(json.dumps(facts, default=str) if as_json else "\n".join(lines))


def _check_formats(text: str) -> list[str]:
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


def _check_folder(folder: Path) -> None:
    """Refuse an output folder that cannot be one, before any work is done."""
    for part in (folder, *folder.parents):
        if part.exists():
            if not part.is_dir():
                raise ValueError(f"--out {str(folder)!r}: {str(part)!r} is a file; name a folder")
            try:
                tempfile.TemporaryFile(dir=part).close()
            except OSError as err:
                raise ValueError(
                    f"--out {str(folder)!r}: cannot write in {str(part)!r} ({err.strerror}); "
                    "name another folder"
                ) from err
            return


def _check_targets(out: Path, formats: list[str]) -> None:
    for name in formats:
        if (target := out / f"dance.{name}").is_dir():
            raise ValueError(
                f"--out {str(out)!r}: {str(target)!r} is a folder; remove it or name another folder"
            )


def _write_all(out: Path, formats: list[str], dance, song) -> list[Path]:
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


COMMANDS = {"generate": Generate, "train": Train, "warm": Warm, "doctor": Doctor}
KINDS = {
    int: "a whole number",
    float: "a number",
    float | None: "a number",
    tuple[int, ...] | None: "whole numbers, such as 1 0 2",
}


def main(args: list[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    args = sys.argv[1:] if args is None else args
    # Before torch is imported: threads wait for each other actively, but not for long. Measured on
    # two cores, 5 s of dance: 3.2 s (2.8 by default), and 9 s (51) beside another busy program.
    os.environ.setdefault("GOMP_SPINCOUNT", "5000")
    try:
        _parse(args).run()
    except ValueError as err:
        print(f"dancediff: {_one_line(err)}", file=sys.stderr)
        return 2
    except OSError as err:
        fix = "check the path, its permissions and the free space"
        print(f"dancediff: {_one_line(err)}; {fix}", file=sys.stderr)
        return 2
    except RuntimeError as err:
        print(f"dancediff: {_one_line(err)}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("dancediff: stopped", file=sys.stderr)
        return 130
    return 0


def _parse(args: list[str]):
    union = Annotated[Generate, tyro.conf.subcommand("generate", prefix_name=False)]
    for name, command in list(COMMANDS.items())[1:]:
        union = union | Annotated[command, tyro.conf.subcommand(name, prefix_name=False)]
    words = io.StringIO()
    try:
        with contextlib.redirect_stderr(words):
            return tyro.cli(union, args=args, prog="dancediff")
    except SystemExit as stop:
        if stop.code in (0, None):  # --help
            raise
        raise ValueError(_explain(args, words.getvalue())) from stop


def _explain(args: list[str], words: str) -> str:
    """One plain line out of the parser's drawn box: the option, the value and the fix.

    >>> _explain(["generate", "song.ogg", "--seed", "1.5"], "| Error parsing --seed: invalid")
    "--seed '1.5': give a whole number; see `dancediff generate --help`"
    """
    command = args[0] if args else ""
    if command not in COMMANDS:
        what = f"{command!r} is no command; choose" if command else "choose a command:"
        return f"{what} {', '.join(COMMANDS)}; see `dancediff --help`"
    see = f"; see `dancediff {command} --help`"
    bare = [
        re.sub(r"\x1b\[[0-9;]*m|[\u2500-\u257f|]", "", line).strip() for line in words.splitlines()
    ]
    if bad := re.search(r"parsing (--[\w-]+)", " ".join(bare)):
        option = bad[1]
        kind = KINDS.get(COMMANDS[command].__annotations__.get(option[2:]), "another value")
        return f"{option} {_value_of(option, args)!r}: give {kind}{see}"
    parts, near = [], re.search(r"meant: (--[\w-]+)", " ".join(bare))
    for line in bare[1:]:  # the first line is the title of the box
        if not line or line.startswith(("For full helptext", "Perhaps you meant")):
            if parts:
                break
            continue
        parts.append(line)
    hint = f"; do you mean {near[1]}?" if near else ""
    return (" ".join(parts).rstrip(".") or f"cannot understand {' '.join(args)!r}") + hint + see


def _value_of(option: str, args: list[str]) -> str:
    for k, arg in enumerate(args):
        if arg.startswith(f"{option}="):
            return arg.removeprefix(f"{option}=")
        if arg == option:
            rest = args[k + 1 :]
            stop = next((i for i, word in enumerate(rest) if word.startswith("--")), len(rest))
            return " ".join(rest[:stop])
    return ""


def _one_line(err: BaseException) -> str:
    return " ".join(str(err).split()) or type(err).__name__


if __name__ == "__main__":
    sys.exit(main())
