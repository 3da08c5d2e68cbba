r"""From a TOML file to a trained model: what ``dancediff train`` runs."""

import tomllib
from dataclasses import fields
from pathlib import Path

import torch

from dancediff.data.windows import GroupDanceWindows, Take, choreographed_corpus
from dancediff.motion.representation import Normalizer
from dancediff.music.features import MusicNormalizer
from dancediff.tcdiffpp.losses import LossWeights
from dancediff.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.loop import TrainConfig, train

MIN_SPAN = 0.2  # of a channel's range, in metres or matrix entries
_DATA = {"songs", "first_seed", "seconds", "dancers_per_batch", "workers"}


def read_config(path) -> dict:
    """Read and check a training config.

    Raises: ValueError naming the file, the table and the key that is unknown.
    """
    path = Path(path)
    try:
        config = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as err:
        raise ValueError(f"config {str(path)!r} does not exist; see configs/") from err
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as err:
        raise ValueError(f"config {str(path)!r} is no TOML file: {err}") from err
    known = {
        "data": _DATA,
        "model": {f.name for f in fields(TCDiffPPConfig)},
        "train": {f.name for f in fields(TrainConfig)} - {"weights"},
        "weights": {f.name for f in fields(LossWeights)},
    }
    for table, values in config.items():
        for key in [table] if table not in known else set(values) - known[table]:
            raise ValueError(
                f"{str(path)!r}: {table!r} has no {key!r}; known: {known.get(table, known)}"
            )
    return {table: dict(config.get(table, {})) for table in known}


def fit_statistics(model: TCDiffPP, takes: list[Take]) -> None:
    """Set the scales of motion and music and the spectrum of dance from the takes, once."""
    stack = torch.cat([take.x.flatten(0, 1) for take in takes])
    model.normalizer = Normalizer.fit(stack, min_span=MIN_SPAN)
    songs = {take.M.data_ptr(): take.M for take in takes}
    model.music_normalizer = MusicNormalizer.fit(list(songs.values()))
    if model.decoder.precondition is not None:
        f = model.config.num_frames
        model.decoder.precondition.fit(
            model.normalizer.normalize(take.x.unfold(1, f, f // 2).flatten(0, 1).transpose(1, 2))
            for take in takes
        )


def train_from_config(path, out, *, resume: bool = False, takes: list[Take] | None = None):
    """Make the data, build the model, train it; returns the averaged model.

    ``takes`` replaces the choreographed corpus. Raises: ValueError for a bad config.
    """
    config = read_config(path)
    data = {"songs": 100, "first_seed": 0, "seconds": 30.0, "workers": 2} | config["data"]
    if takes is None:
        seeds = range(data["first_seed"], data["first_seed"] + data["songs"])
        takes = choreographed_corpus(list(seeds), seconds=data["seconds"], workers=data["workers"])
    settings = TrainConfig(**config["train"], weights=LossWeights(**config["weights"]))
    torch.manual_seed(settings.seed)
    model = TCDiffPP(TCDiffPPConfig(**config["model"]))
    fit_statistics(model, takes)
    windows = GroupDanceWindows(
        takes,
        num_frames=model.config.num_frames,
        dancers_per_batch=data.get("dancers_per_batch", 24),
        seed=settings.seed,
    )
    return train(model, windows, settings, out, resume=resume)
