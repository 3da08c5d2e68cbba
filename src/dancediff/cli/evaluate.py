"""`dancediff evaluate`: every metric of some dances as a table.

Read first: `dancediff.cli.files` · docs/metrics_report.md.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from dancediff.cli.files import check_folder, tell


@dataclass
class Evaluate:
    """Measure dances: print a table of every metric, with intervals."""

    motion: tyro.conf.Positional[tuple[str, ...]]
    """Dances (.npz, .glb, .bvh, .pkl, .npy), folders of them, or prepared folders."""
    song: str | None = None
    """Sound file whose beats are taken for dances that bring none; 'packaged' for the song that
    comes with dancediff."""
    reference: str | None = None
    """Real dances, as a folder or file: FID, Div and GMR compare with them."""
    metric: tuple[str, ...] = ()
    """Metrics of your own, each MODULE:FUNCTION, called with joints and fps."""
    window: int = 0
    """Cut every dance into windows of so many frames; 0 leaves it whole."""
    keep: Path | None = None
    """A folder for each dance's measurements: what is there is not measured again."""
    workers: int = 0
    """How many processes; 0 for one on each core."""
    backend: Literal["loky", "dask", "ray"] = "loky"
    """Processes of this machine, or a Dask or Ray cluster."""
    scheduler: str | None = None
    """Address of a running cluster; default: one on this machine."""
    seed: int = 0
    """Of the bootstrap draws."""
    drift: Path | None = None
    """A PNG file: how posture changes over the dances, also printed as a table, 5 s a line."""
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
            raise ValueError("name dances or folders of them; see `dancediff evaluate --help`")
        self._check_files()
        if self.keep is not None:
            check_folder(self.keep, "--keep")
        song = hub.packaged_song() if self.song in ("packaged", hub.SONG) else self.song
        report = evaluate_dances(
            list(self.motion),
            reference=self.reference,
            song=song,
            window=self.window or None,
            metrics=self.metric,
            seed=self.seed,
            kept=self.keep,
            progress=not self.json,
            workers=self.workers or joblib.cpu_count(),
            backend=self.backend,
            scheduler=self.scheduler,
        )
        # folders are made now, not before: where nothing could be measured none is left
        if self.out is not None:
            self.out.parent.mkdir(parents=True, exist_ok=True)
            report.save(self.out)
        lines = [str(report)]
        if self.drift is not None and report.drift is not None:
            heading = "mean over dances, window by window, as far as the shortest goes:"
            lines += ["", heading, str(report.drift)]
        tell(self.json, report.facts(), lines)
        if self.drift is not None and report.drift is not None:
            self.drift.parent.mkdir(parents=True, exist_ok=True)
            self._draw(report.drift, self.drift)
        if report.is_empty:
            why = next(row.reason for row in report.rows)
            raise RuntimeError(f"no metric could be computed; {report.rows[0].name}: {why}")
        if report.skipped:
            raise RuntimeError(
                f"{len(report.skipped)} dances could not be read and are left out, see above"
            )
        if self.drift is not None and report.drift is None:
            raise RuntimeError(
                f"--drift {str(self.drift)!r} is not written: no dance of 5 s or more could be "
                "measured; leave it out"
            )

    @staticmethod
    def _draw(drift, path: Path) -> None:
        from matplotlib.pyplot import close

        from dancediff.viz.charts import plot_drift
        from dancediff.viz.style import save_figure

        figure = plot_drift(drift, title="Posture over the dance").figure
        save_figure(figure, path)
        close(figure)

    def _check_files(self) -> None:
        """Refuse files that cannot be written, or that are read here."""
        given = {"out": self.out, "drift": self.drift}
        files = {name: path for name, path in given.items() if path is not None}
        for name, path in files.items():
            if path.is_dir():
                raise ValueError(f"--{name} {str(path)!r} is a folder; name a file in it")
            check_folder(path.parent, f"--{name}")
        if self.drift is not None and self.drift.suffix.lower() != ".png":
            raise ValueError(f"--drift {str(self.drift)!r} is a picture; name a file in .png")
        if len({path.resolve() for path in files.values()}) < len(files):
            raise ValueError(f"--out and --drift are both {str(self.out)!r}; name two files")
        read = self._read() if files else set()
        for name, path in files.items():
            if path.resolve() in read:
                raise ValueError(
                    f"--{name} {str(path)!r} is read here and would be replaced; name another file"
                )

    def _read(self) -> set[Path]:
        """The files that dances, the reference and the song come from."""
        from dancediff.metrics.dances import find_dances

        sources = [*self.motion] if self.reference is None else [*self.motion, self.reference]
        read = {source.resolve() for source in find_dances(sources) if isinstance(source, Path)}
        return read if self.song is None else read | {Path(self.song).resolve()}
