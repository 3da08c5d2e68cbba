"""Dances to many songs, on this machine or on a cluster; what is made is not made again.

Read first: `dancediff.backends` · `dancediff.cli.song_list` · docs/cluster.md.

A dance has a folder of its own in OUT, with a ``dance.json``, written last, that says how it was
made: a hash of the sound, the weights, the options, the formats and our code. A run that was killed
goes on with the songs that have none.
"""

import json
import shutil
import socket
import zipfile
from collections import Counter
from dataclasses import dataclass, field
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path

import numpy as np
from tqdm.auto import tqdm

from dancediff import hub
from dancediff.atomic import is_full, write_text
from dancediff.axes import FPS
from dancediff.backends import check_backend, run_jobs
from dancediff.cli.files import HIDDEN, check_targets, file_of, song_named
from dancediff.cli.one_song import dance_to
from dancediff.cli.song_list import PACKAGED, SongRow
from dancediff.data.cache import code_digest
from dancediff.own import own_digests

MADE, KEPT = "made", "kept"
FACTS = "dance.json"
MODELS = 3  # that a process keeps in memory
CODE = (
    *("music", "motion", "data", "diffusion", "nn", "papers", "extensions", "generation"),
    *("viz", "export", "io"),
)


@dataclass
class ManySongs:
    """What a run did; ``str`` is a table."""

    rows: list[SongRow]
    outcomes: dict[str, str] = field(default_factory=dict)  # by name: made, kept or the reason
    facts_of: dict[str, dict] = field(default_factory=dict)  # what is said of each dance

    @property
    def failed(self) -> dict[str, str]:
        """Why there is no dance, by name."""
        return {
            row.name: self.outcomes[row.name]
            for row in self.rows
            if self.outcomes[row.name] not in (MADE, KEPT)
        }

    def facts(self) -> dict:
        """The same as plain JSON."""
        counts = Counter(self.outcomes.values())
        dances = {row.name: self.facts_of.get(row.name) for row in self.rows}
        return {
            "made": counts[MADE],
            "kept": counts[KEPT],
            "failed": self.failed,
            "dances": {name: facts for name, facts in dances.items() if facts},
        }

    def __str__(self) -> str:
        """A line a dance, then the songs that failed, each with the reason."""
        width = max(len("dance"), *(len(row.name) for row in self.rows))
        lines = [f"{'dance':{width}}  dancers  seconds  {'seed':>6}  model"]
        for row in self.rows:
            facts, outcome = self.facts_of.get(row.name), self.outcomes[row.name]
            if facts is None:
                lines.append(f"{row.name:{width}}  failed")
                continue
            lines.append(
                f"{row.name:{width}}  {facts['dancers']:7}  {facts['frames'] / FPS:7.1f}  "
                f"{facts['seed']:6}  {facts['model']}  {outcome}"
            )
        counts, failed = Counter(self.outcomes.values()), self.failed
        lines += ["", f"made {counts[MADE]}, kept {counts[KEPT]}, failed {len(failed)}"]
        return "\n".join(lines + [f"    {name}: {reason}" for name, reason in failed.items()])


@dataclass(frozen=True)
class DanceJob:
    """All that another process, perhaps on another machine, must know to make a dance."""

    row: SongRow
    folder: Path  # the dance's own; the one above it must be there
    out: Path
    formats: list[str]
    code: str  # the caller's
    own: str | None = None  # the class of a network that is not of this package


def dance_to_many(
    rows: list[SongRow],
    out,
    formats: list[str],
    *,
    workers: int = 1,
    backend: str = "loky",
    scheduler: str | None = None,
    progress: bool = True,
    own: str | None = None,
) -> ManySongs:
    """Make the dances of ``rows`` that the folder ``out`` lacks.

    ``workers``, ``backend``, ``scheduler``: see `dancediff.backends.run_jobs`; ``own``: see
    `dancediff.hub.load`. One run at a time may make a dance. Every process loads a model once. A
    song that cannot be danced to is told in the result, and no reason to stop.

    Raises: ValueError naming an unknown model or the argument; RuntimeError when a machine of a
    cluster has another version of dancediff, or no such folder.
    """
    check_backend(workers, backend, scheduler)
    out = Path(out).absolute()
    models = {row.model: hub.model_folder(row.model) for row in rows}
    code = code_digest(CODE)
    jobs = []
    for row in rows:
        song = row.song if row.song in PACKAGED else str(Path(row.song).absolute())
        place = models[row.model]
        model = row.model if place.is_relative_to(hub.ASSETS) else str(place.absolute())
        whole = SongRow(row.name, song, model, row.options)
        jobs.append(DanceJob(whole, out / row.name, out, formats, code, own))
    out.mkdir(parents=True, exist_ok=True)
    summary = ManySongs(rows)
    outcomes = run_jobs(make_dance, jobs, workers=workers, backend=backend, scheduler=scheduler)
    with tqdm(total=len(jobs), desc="dancing", unit="song", disable=not progress) as bar:
        for k, outcome in outcomes:
            name = rows[k].name
            if isinstance(outcome, tuple):
                summary.outcomes[name], summary.facts_of[name] = outcome
            else:
                summary.outcomes[name] = str(outcome)
                bar.set_postfix(failed=len(summary.outcomes) - len(summary.facts_of))
            bar.update()
    return summary


def make_dance(job: DanceJob) -> tuple[str, dict] | str:
    """Dance to one song, unless it is done: ("made" or "kept", what is said of it), or why not."""
    if not job.out.is_dir():
        raise RuntimeError(
            f"{str(job.out)!r} does not exist on {socket.gethostname()}; --out must be a folder "
            "that all machines see under one path"
        )
    if code_digest(CODE) != job.code:
        raise RuntimeError(
            f"{socket.gethostname()} has another version of dancediff; install the same everywhere"
        )
    try:
        recipe = recipe_of(job)
        old = read_facts(job.folder)
        if old.get("made_by") == recipe:
            return KEPT, old
        return MADE, _dance(job, recipe, old)
    except Exception as err:  # one odd song must not end a run over thousands
        if is_full(err):
            raise
        kind = "" if isinstance(err, ValueError) else f"{type(err).__name__}: "
        return f"{kind}{' '.join(str(err).split())}"


def _dance(job: DanceJob, recipe: str, old: dict) -> dict:
    """Write the files, then what is said of them: without it they do not count."""
    song = song_named(job.row.song)
    check_targets(job.folder, job.formats)
    model = loaded(job.row.model, job.own)
    facts_file = job.folder / FACTS
    facts_file.unlink(missing_ok=True)
    for left in job.folder.glob(f"{HIDDEN}*"):  # of a run that was killed
        shutil.rmtree(left, ignore_errors=True)
    finish = partial(add_beats, beats=song.beats()) if "npz" in job.formats else None
    facts, _ = dance_to(song, model, job.row.options, job.formats, job.folder, finish)
    files = [path.name for path in facts["files"]]
    for name in set(old.get("files", [])) - set(files):
        (job.folder / name).unlink(missing_ok=True)
    text = json.dumps(facts | {"files": files, "made_by": recipe}, indent=1, default=str)
    write_text(facts_file, text + "\n")
    return json.loads(text)


def add_beats(folder: Path, beats: np.ndarray) -> None:
    """Put the beats into the .npz: `dancediff evaluate` then compares a dance with its own song."""
    path = folder / file_of("npz")
    with zipfile.ZipFile(path, "a") as archive, archive.open("beats.npy", "w") as file:
        np.lib.format.write_array(file, np.asarray(beats, dtype=np.float64))


def read_facts(folder: Path) -> dict:
    """What is said of a dance that is there, whole, in a folder; empty where there is none."""
    try:
        facts = json.loads((folder / FACTS).read_text(encoding="utf-8"))
        return facts if all((folder / name).is_file() for name in facts["files"]) else {}
    except (OSError, ValueError, TypeError, KeyError):
        return {}


@lru_cache(maxsize=MODELS)
def loaded(model: str, own: str | None = None):
    """A model, which a process reads once."""
    return hub.load(model, own=own)


def recipe_of(job: DanceJob) -> str:
    """A hash of what a dance follows from; places of files do not count, their names do."""
    song = Path(job.row.song)
    words = [job.code, model_digest(job.row.model), song.stem, job.formats]
    own = own_digests([job.own, job.row.options.get("sampler")])
    words += [str(own)] if own else []
    digest = sha256(repr([*words, sorted(job.row.options.items())]).encode())
    if song.is_file():
        with song.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()[:16]


@lru_cache(maxsize=MODELS)
def model_digest(model: str) -> str:
    """A hash of a model folder's name, sizes and weights."""
    folder = hub.model_folder(model)
    digest = sha256(folder.name.encode())
    for path in sorted([folder / "config.json", *folder.glob("*.safetensors")]):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()
