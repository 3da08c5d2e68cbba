"""`dancediff convert`: a dance in another format."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from dancediff.cli.files import check_folder, song_named, tell


@dataclass
class Convert:
    """Write a dance in another format: npz, bvh, glb, smpl.npz, html, mp4, gif, png."""

    files: tyro.conf.Positional[tuple[Path, ...]]
    """The dance (.npz, .glb, .bvh, .smpl.npz, .pkl, .npy; of a group a file for each dancer may be
    given), then the file to write, whose suffix says the format."""
    song: str | None = None
    """A sound file for .mp4 and .html; 'packaged' for the song of the package."""
    body: Literal["mannequin", "mesh"] = "mannequin"
    """What moves in a .glb."""
    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Read, then write; a group becomes a .bvh or .smpl.npz for each dancer."""
        if len(self.files) < 2:
            raise ValueError(
                f"{len(self.files)} files are given; name a dance, then the file to write, such as "
                "dance.npz dance.glb"
            )
        *sources, target = self.files
        from dancediff import io
        from dancediff.motion.motion import Motion

        if io.suffix_of(target) not in io.SUFFIXES:
            known = " ".join(io.SUFFIXES)
            raise ValueError(f"{str(target)!r}, the file to write, should end in one of {known}")
        if target.exists() and io.suffix_of(target) == io.suffix_of(sources[-1]):
            raise ValueError(
                f"{str(target)!r}, the file to write, is there already and may be a dance to read, "
                f"as {str(sources[-1])!r} is; name a new file last"
            )
        for source in sources:
            if not source.exists():
                raise ValueError(f"{str(source)!r} does not exist; name a dance")
        check_folder(target.parent, "the folder of")
        song = None if self.song is None else song_named(self.song)
        dance = Motion.load(*sources)
        # of a group files beside the target are written, and those of older dancers removed
        lost = {file.resolve() for file in io.replaced_by(target, dance.num_dancers)}
        if read := [str(source) for source in sources if source.resolve() in lost]:
            raise ValueError(
                f"to write {str(target)!r} would replace or remove {', '.join(map(repr, read))}, "
                "read here; name another file last"
            )
        target.parent.mkdir(parents=True, exist_ok=True)
        written = dance.save(target, song, body=self.body)
        facts = {"written": written, "dancers": dance.num_dancers, "frames": dance.num_frames}
        more = "" if written == target else f" and so on, a file for each of {dance.num_dancers}"
        tell(self.json, facts, [f"written: {written}{more}"])
