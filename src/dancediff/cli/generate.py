"""`dancediff generate`: one song, or many.

Read first: `dancediff.cli.options` · `dancediff.cli.one_song` · `dancediff.cli.many_songs`.
"""

from dataclasses import dataclass, make_dataclass
from math import isnan
from pathlib import Path
from typing import Literal

import tyro

from dancediff.cli.files import (
    USUAL,
    check_folder,
    check_formats,
    check_targets,
    of_an_earlier_dance,
    song_named,
    tell,
)
from dancediff.cli.options import FIELDS, command_option, given


@dataclass
class _Generate:
    """What there is beside the options of a request."""

    songs: tyro.conf.Positional[tuple[str, ...]]
    """A wav, flac, ogg or mp3 file; 'packaged' for the song that comes with dancediff. Or many: a
    list, a folder, or a manifest.csv with a row a dance; each gets a folder of its own in OUT."""
    model: str = "tcdiffpp"
    """A packaged model's name, or a model folder."""
    own: str | None = None
    """The class of a model folder whose network is your own: MODULE:CLASS."""
    out: Path = Path("out")
    """Folder for the results."""
    formats: str = ",".join(USUAL)
    """Which files to write, of npz, mp4, png, html (a player), glb; bvh, smpl (one a dancer)."""
    workers: int | None = None
    """For many songs: how many are danced to at once; default: 1."""
    backend: Literal["loky", "dask", "ray"] | None = None
    """For many songs: loky, processes of this machine, or a Dask or Ray cluster."""
    scheduler: str | None = None
    """Address of a running cluster; default: one on this machine."""
    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Check what is cheap to check, dance, then write all files of a dance or none."""
        from dancediff import hub
        from dancediff.cli.one_song import dance_to
        from dancediff.cli.song_list import are_many

        if not self.songs:
            raise ValueError(
                "generate what? give a wav, flac, ogg or mp3 file, several, a folder or a "
                "manifest; see `dancediff generate --help`"
            )
        formats = check_formats(self.formats)
        check_folder(self.out)
        options = given(self)
        how = {name: getattr(self, name) for name in ("workers", "backend", "scheduler")}
        how = {name: value for name, value in how.items() if value is not None}
        if how or are_many(self.songs):
            self._run_many(options, formats, how)
            return
        check_targets(self.out, formats)
        song = song_named(self.songs[0])
        model = hub.load(self.model, own=self.own)
        facts, dance = dance_to(
            song, model, options | {"progress": not self.json}, formats, self.out
        )
        length = f"{facts['frames'] / dance.fps:.1f} s"
        heard = "no beat" if isnan(song.tempo) else f"{song.tempo:.0f} beats a minute"
        genre = f", danced as {facts['genre']}" if facts.get("genre") else ""
        lines = [f"{dance.people}, {length}, to {song.name!r} ({heard}{genre}):"]
        older = of_an_earlier_dance(self.out, facts["files"])
        tell(self.json, facts, lines + [f"  {file}" for file in facts["files"]] + older)

    def _run_many(self, options: dict, formats: list[str], how: dict) -> None:
        from dancediff.cli.many_songs import dance_to_many
        from dancediff.cli.song_list import song_list

        rows = song_list(self.songs, self.model, options)
        how |= {"progress": not self.json, "own": self.own}
        summary = dance_to_many(rows, self.out, formats, **how)
        tell(self.json, summary.facts(), [str(summary), f"dances: {self.out}"])
        if summary.failed:
            raise RuntimeError(
                f"{len(summary.failed)} of {len(rows)} songs failed, see above; the same command "
                "tries them again, and keeps what is made"
            )


Generate = make_dataclass("Generate", map(command_option, FIELDS.values()), bases=(_Generate,))
Generate.__doc__ = "Make a group dance to a song, or to many."
