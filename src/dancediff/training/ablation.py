r"""Take a part away, train again, measure: what ``dancediff ablate`` runs.

Read first: `dancediff.training.ablation_config` · TCDiff++ section 5.4, table 4.

In the output folder

    songs/                  the training set, made once
    trainings/KEY/          config.toml, checkpoint, losses.csv, model/; KEY follows from the tables
    variants/NAME/          scores.json and KEY/dance_0.npz ...
    results.json, .md       the table, written anew after every training

so a variant that is done is not done again, a training that was stopped goes on from its
checkpoint, and variants that only sample in another way share one training. What is done is
recognised by the config and the user's own code that it names: after a change of the library's
models take another folder.
"""

import json
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import torch

from dancediff import __version__
from dancediff.atomic import write_text, write_toml
from dancediff.extensions.genre_condition import genres_of
from dancediff.generation.pipeline import Pipeline, pipeline_of, usable_device
from dancediff.motion.motion import Motion
from dancediff.training.ablation_config import CHOREOGRAPHER, Variant, key_of, read_ablation
from dancediff.training.ablation_data import (
    corpus,
    held_out_dances,
    held_out_genres,
    held_out_orders,
    held_out_songs,
    reference_dances,
)
from dancediff.training.ablation_table import mean_of_seeds, metric_scores, table
from dancediff.training.run import train_from_config

_worker_device: list[str] = []  # of a worker process


def run_ablation(
    path,
    out,
    *,
    devices: tuple[str, ...] = ("cpu",),
    evaluate: Callable | None = None,
    save: Callable | None = None,
) -> list[dict]:
    """Train, sample and evaluate every variant of a config; returns the rows of the table.

    - ``devices``: trainings run side by side, one on each; a device may be named twice.
    - ``evaluate(dances, reference=, songs=) -> {metric: {"value", "low", "high", ...}}``, lists of
      `Motion` and `Music`; default `dancediff.training.ablation_table.metric_scores`. It is known
      by its name: what a function of another name found is not taken over.
    - ``save(model, folder)`` keeps each trained model, for instance `dancediff.hub.save_model`.

    A row is {"variant", "training", "scores"}, with "of" if it is one of several seeds. It has
    "failed" (why) instead of scores where something went wrong; that does not stop the others, and
    is tried again next time. The first row is the choreographer's own dances to the same songs.
    Raises: ValueError for a bad config or device, before anything is done.
    """
    variants, out = read_ablation(path), Path(out)
    if not devices:
        raise ValueError("devices is empty; name at least one, such as 'cpu' or 'cuda:0'")
    for device in devices:
        usable_device(device)
    first = variants[0]
    corpus(first, out)  # made once here, or every worker would begin to make it
    how: dict[str, Any] = {"reference": reference_dances(first), "songs": held_out_songs(first)}
    if metrics := first.held_out.metrics:
        how["metrics"] = metrics
    scores = partial(_scores, evaluate=evaluate or metric_scores, how=how)

    key = first.key_with_metrics(key_of([first.tables["data"], first.held_out.facts()]))
    truth = scores(out / "variants" / CHOREOGRAPHER, key, held_out_dances(first))
    rows = [{"variant": CHOREOGRAPHER, "scores": truth}]
    failed: dict[str, str] = {}
    for found in _run_jobs(_jobs(variants, out), out, devices, save):
        failed |= found
        _write(rows + _rows(variants, failed, out, scores), out)
    rows += _rows(variants, failed, out, scores)
    _write(rows, out)
    return rows


def _rows(variants: list[Variant], failed: dict[str, str], out: Path, scores: Callable) -> list:
    """A row of the table for each variant that has danced or failed."""
    rows = []
    for variant in variants:
        row: dict[str, Any] = {"variant": variant.name, "training": variant.training}
        row |= {"of": variant.of} if variant.of else {}
        if variant.name in failed:
            rows.append(row | {"failed": failed[variant.name]})
        elif all(path.exists() for path in _dance_files(variant, out)):
            folder = out / "variants" / variant.name
            row["scores"] = scores(folder, variant.scores_key, _dances(variant, out))
            rows.append(row)
    return rows


def _write(rows: list[dict], out: Path) -> None:
    write_text(out / "results.json", json.dumps(rows, indent=2) + "\n")
    write_text(out / "results.md", table(mean_of_seeds(rows)))


def _jobs(variants: list[Variant], out: Path) -> list[list[Variant]]:
    """What has not danced yet, one list a training."""
    jobs: dict[str, list[Variant]] = {}
    for variant in variants:
        if not all(path.exists() for path in _dance_files(variant, out)):
            jobs.setdefault(variant.training, []).append(variant)
    return list(jobs.values())


def _run_jobs(jobs, out: Path, devices, save) -> Iterator[dict[str, str]]:
    """Run all jobs; after each, why variants failed, by their names."""
    if len(devices) == 1 or len(jobs) < 2:
        for job in jobs:
            yield _run_job(job, out, save, devices[0])
        return
    context = get_context("spawn")
    free = context.Queue()
    for device in devices:
        free.put(device)
    threads = max(1, torch.get_num_threads() // len(devices))
    with ProcessPoolExecutor(len(devices), context, _take_device, (free, threads)) as pool:
        yield from pool.map(partial(_run_job, out=out, save=save), jobs)


def _take_device(free, threads: int) -> None:
    """A worker keeps the device that it finds."""
    torch.set_num_threads(threads)
    _worker_device.append(free.get())


def _run_job(job: list[Variant], out: Path, save, device=None) -> dict[str, str]:
    """Train once, then let each variant of the training dance."""
    device = device or _worker_device[0]
    try:
        model = _train(job[0], out, device, save)
    except (RuntimeError, ValueError) as err:
        return {variant.name: f"training: {err}" for variant in job}
    failed = {}
    for variant in job:
        try:
            _dance(model, variant, out)
        except (RuntimeError, ValueError) as err:
            failed[variant.name] = f"dancing: {err}"
    return failed


def _train(variant: Variant, out: Path, device: str, save):
    folder = out / "trainings" / variant.training
    config = folder / "config.toml"
    if not config.exists():
        write_toml(config, variant.tables)
    takes = corpus(variant, out)  # its own: networks of other sizes learn from other takes
    model = train_from_config(config, folder, resume=True, takes=takes, device=device)
    if save is not None:
        save(model, folder / "model")
    return model


def _dance(model, variant: Variant, out: Path) -> None:
    """Dance to every held-out song that has not been danced to."""
    sample, pipeline = variant.sample, pipeline_of(model)
    options = {name: value for name, value in vars(sample).items() if value is not None}
    files = _dance_files(variant, out)
    files[0].parent.mkdir(parents=True, exist_ok=True)
    jobs = zip(files, held_out_songs(variant), _asked(variant, pipeline), strict=True)
    for i, (path, song, asked) in enumerate(jobs):
        if not path.exists():
            pipeline.generate(song, **asked | options | {"seed": sample.seed + i}).save(path)


def _asked(variant: Variant, pipeline: Pipeline) -> list[dict[str, Any]]:
    """The genre of each song, and the order in which the choreographer's dance to it ends."""
    known = genres_of(pipeline.model)
    asked = [{"genre": genre} if genre in known else {} for genre in held_out_genres(variant)]
    if "swap" not in pipeline.request.names() or variant.held_out.dancers == 1:
        return asked
    orders = held_out_orders(variant)
    return [one | {"swap": order} for one, order in zip(asked, orders, strict=True)]


def _dance_files(variant: Variant, out: Path) -> list[Path]:
    """Where the dances of a variant go; another config of the same name goes elsewhere."""
    folder = out / "variants" / variant.name / variant.dances_key
    return [folder / f"dance_{i}.npz" for i in range(variant.held_out.songs)]


def _dances(variant: Variant, out: Path) -> list[Motion]:
    return [Motion.load(path) for path in _dance_files(variant, out)]


def _scores(
    folder: Path, key: str, dances: list[Motion], *, evaluate: Callable, how: dict[str, Any]
) -> dict:
    """Evaluate, or read what this version of the library found before by the same function."""
    path = folder / "scores.json"
    made_by = {"key": key, "dancediff": __version__, "evaluate": _name_of(evaluate)}
    if path.exists():
        stored = json.loads(path.read_text(encoding="utf-8"))
        if {name: stored.get(name) for name in made_by} == made_by:
            return stored["scores"]
    scores = evaluate(dances, **how)
    write_text(path, json.dumps(made_by | {"scores": scores}, indent=2) + "\n")
    return scores


def _name_of(function: Callable) -> str:
    """Module and name; of an object that is called, those of its class."""
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{named.__module__}:{named.__qualname__}"
