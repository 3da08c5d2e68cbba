"""`dancediff evaluate`: every metric of some dances as a table."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from dancediff.cli.files import check_folder, tell


@dataclass
class Evaluate:
    """Measure dances: print a table of every metric, with intervals."""

    motion: tyro.conf.Positional[tuple[str, ...]]
    """Dances as .npz files, folders of them, or prepared folders."""
    song: str | None = None
    """Sound file whose beats are taken for dances that bring none; 'packaged' for the song that
    comes with dancediff."""
    reference: str | None = None
    """Real dances, as a folder or file: FID, Div and GMR compare with them."""
    window: int = 0
    """Cut every dance into windows of so many frames; 0 leaves it whole."""
    workers: int = 0
    """How many processes; 0 for one on each core."""
    seed: int = 0
    """Of the bootstrap draws."""
    out: Path | None = None
    """A file to write the JSON to."""
    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Check what is cheap to check, measure, then print and write."""
        import joblib

        from dancediff import hub
        from dancediff.metrics.report import evaluate_dances

        if not self.motion:
            raise ValueError("name .npz dances or folders; see `dancediff evaluate --help`")
        self._check_out()
        song = hub.packaged_song() if self.song in ("packaged", hub.SONG) else self.song
        report = evaluate_dances(
            list(self.motion),
            reference=self.reference,
            song=song,
            window=self.window or None,
            workers=self.workers or joblib.cpu_count(),
            seed=self.seed,
            progress=not self.json,
        )
        if self.out is not None:
            report.save(self.out)
        tell(self.json, report.facts(), [str(report)])
        if report.is_empty:
            why = next(row.reason for row in report.rows)
            raise RuntimeError(f"no metric could be computed; {report.rows[0].name}: {why}")

    def _check_out(self) -> None:
        if self.out is None:
            return
        if self.out.is_dir():
            raise ValueError(
                f"--out {str(self.out)!r} is a folder; name a file, such as report.json"
            )
        check_folder(self.out.parent)
        self.out.parent.mkdir(parents=True, exist_ok=True)
