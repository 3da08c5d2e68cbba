"""The command line: ``dancediff generate``, ``train``, ``warm`` and ``doctor``.

Exit status: 0 done, 1 nothing could be done though the arguments were fine, 2 bad arguments or
input; the last line then names the value and the fix. torch is imported inside commands only.
"""

import importlib.metadata
import json
import operator
import os
import platform
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

FORMATS = ("npz", "mp4", "png")


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

        formats = [name.strip() for name in self.formats.split(",") if name.strip()]
        for name in formats or [self.formats]:
            if name not in FORMATS:
                raise ValueError(
                    f"--formats {self.formats!r}: {name!r} is not of {','.join(FORMATS)}"
                )
        _check_folder(self.out)
        song = hub.packaged_song() if self.song == "packaged" else hub.Music.load(self.song)
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
        if self.json:
            facts = {"files": [str(f) for f in files], "frames": dance.num_frames, **dance.meta}
            print(json.dumps(facts, default=str))
            return
        print(f"{self.dancers} dancers, {dance.duration:.1f} s, to {song.name!r}:")
        for file in files:
            print(f"  {file}")


@dataclass
class Train:
    """Train a model from a TOML config and write it as a model folder."""

    config: tyro.conf.Positional[Path]
    """For instance configs/tcdiffpp_small.toml."""
    out: Path = Path("runs/tcdiffpp")
    """Folder for checkpoint, losses and the model."""
    resume: bool = False
    """Go on from the checkpoint in the folder, if there is one."""

    def run(self) -> None:
        """Train, then save the averaged model in OUT/model."""
        from dancediff import hub
        from dancediff.training.run import train_from_config

        _check_folder(self.out)
        model = train_from_config(self.config, self.out, resume=self.resume)
        folder = hub.save_model(
            model, self.out / "model", card=f"Trained from {self.config.name}.\n"
        )
        print(f"model folder: {folder}")


@dataclass
class Warm:
    """Compile librosa's inner loops once, so that the first dance does not wait for it."""

    def run(self) -> None:
        """Compute the features of the packaged song."""
        from dancediff import hub

        song = hub.packaged_song()
        song.features()
        print(f"ready: {song.name!r}, {song.duration:.0f} s, {song.tempo:.0f} beats a minute")


@dataclass
class Doctor:
    """Say which versions are here, and what is missing."""

    def run(self) -> None:
        """Print one line a package."""
        print(f"python {platform.python_version()} on {platform.system()} {platform.machine()}")
        extras = {"av": "video", "pythreejs": "notebooks", "ipywidgets": "notebooks"}
        for name in ("dancediff", "torch", "numpy", "librosa", "soundfile", *extras):
            try:
                print(f"{name} {importlib.metadata.version(name)}")
            except importlib.metadata.PackageNotFoundError:
                extra = f"[{extras[name]}]" if name in extras else ""
                print(f'{name} is missing: pip install "dancediff{extra}"')


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


def _write_all(out: Path, formats: list[str], dance, song) -> list[Path]:
    """Write every file in a hidden folder first, then move all of them into place."""
    made = [part for part in (out, *out.parents) if not part.exists()]
    work = None
    try:
        out.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=".dancediff-", dir=out))
        for suffix in formats:
            dance.save(work / f"dance.{suffix}", song=song)
        return [(work / f"dance.{s}").replace(out / f"dance.{s}") for s in formats]
    except BaseException:
        for part in made:
            shutil.rmtree(part, ignore_errors=True)
        raise
    finally:
        if work is not None:
            shutil.rmtree(work, ignore_errors=True)


COMMANDS = {"generate": Generate, "train": Train, "warm": Warm, "doctor": Doctor}


def main(args: list[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    args = sys.argv[1:] if args is None else args
    # before torch is imported: waiting threads that spin slow each other down many times over
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    try:
        _parse(args).run()
    except (ValueError, OSError) as err:
        print(f"dancediff: {_one_line(err)}", file=sys.stderr)
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
    try:
        return tyro.cli(union, args=args, prog="dancediff")
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        shown = " ".join(args) or "nothing"
        raise ValueError(f"cannot understand {shown!r}; see `dancediff --help`") from stop


def _one_line(err: BaseException) -> str:
    return " ".join(str(err).split()) or type(err).__name__


if __name__ == "__main__":
    sys.exit(main())
