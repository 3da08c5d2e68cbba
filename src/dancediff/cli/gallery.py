"""`dancediff gallery`: a page with players and metrics of many dances."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from dancediff.cli.files import check_folder, song_named, tell


@dataclass
class Gallery:
    """Make a page of all dances in a folder: pictures, metrics, players; failures included."""

    folder: tyro.conf.Positional[Path]
    """Where the dances are (.npz, .glb, .bvh), in folders within it, too."""
    song: str | None = None
    """A sound file that all of them danced to; 'packaged' for the song of the package."""
    out: Path | None = None
    """Folder for the page; default: gallery, in that folder."""
    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Check what is cheap to check, then draw and measure every dance."""
        from dancediff.viz.gallery import save_gallery

        if not self.folder.is_dir():
            raise ValueError(f"{str(self.folder)!r} is no folder; name one that holds dances")
        out = self.out or self.folder / "gallery"
        check_folder(out)
        song = None if self.song is None else song_named(self.song)
        made = save_gallery(self.folder, out, song, progress=not self.json)
        lines = [f"{len(made.dances)} dances: {made.index}"]
        lines += [f"  no dance: {name}: {why}" for name, why in made.failed.items()]
        facts = {"index": made.index, "dances": made.dances, "failed": made.failed}
        tell(self.json, facts, lines)
        if not made.dances:
            raise ValueError(
                f"not one dance in {str(self.folder)!r} could be read, see above; name a folder "
                "that holds some"
            )
