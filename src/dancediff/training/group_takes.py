"""What models of groups learn from: takes of a prepared folder or choreographed ones; windows."""

import warnings
from functools import partial
from pathlib import Path

from dancediff.data.augment import Augmentation
from dancediff.data.choreographed import choreographed_corpus
from dancediff.data.packed import PackedTakes
from dancediff.data.take import DanceTake
from dancediff.data.windows import GroupCut, WindowSampler
from dancediff.extensions.energy_condition import listens_to_energy
from dancediff.extensions.genre_condition import genres_of
from dancediff.training.config import GroupData


def prepared_takes(folder, sizes, split: str = "train") -> list[DanceTake]:
    """Takes of a prepared folder that a model of these sizes can learn from: long and small enough.

    Raises: ValueError when the folder is not prepared, or has no take to train on.
    """
    most = getattr(sizes, "max_dancers", 5)
    takes = PackedTakes(folder, split).takes(num_frames=sizes.num_frames, max_dancers=most)
    text = f"{str(folder)!r} has no take in {split!r} with music, {sizes.num_frames} frames and at "
    text += f"most {most} dancers; prepare more data"
    if not takes and split == "train":
        raise ValueError(text)
    if not takes:
        warnings.warn(f"{text}, or leave evaluate_every out: there is no validation", stacklevel=4)
    return takes


def solos_of(takes: list[DanceTake]) -> list[DanceTake]:
    """Every dancer alone, in the middle of the stage."""
    return [solo for take in takes for solo in take.solos(centred=True)]


def takes_for(
    corpus: GroupData, folder, sizes, *, evaluates: bool = False, cache: Path | None = None
) -> tuple[list[DanceTake], list[DanceTake]]:
    """Takes to learn from, and takes to evaluate on where that is wanted."""
    if folder := folder or corpus.folder:
        held_out = prepared_takes(folder, sizes, "val") if evaluates else []
        return prepared_takes(folder, sizes), held_out
    end = corpus.songs + (corpus.held_out if evaluates else 0)
    make = partial(
        choreographed_corpus,
        seconds=corpus.seconds,
        varied=corpus.varied,
        workers=corpus.workers,
        cache=cache,
    )
    return make(range(corpus.songs)), make(range(corpus.songs, end))


def windows_of(
    takes: list[DanceTake], corpus: GroupData, model, *, seed: int = 0, any_song: float = 0.0
) -> WindowSampler:
    """Windows of takes, drawn as ``corpus`` says, as long as the model's segments."""
    augment = Augmentation(
        mirror=corpus.mirror,
        rotate=corpus.rotate,
        shift=corpus.shift,
        music=corpus.music,
        any_song=any_song,
    )
    return WindowSampler(
        takes,
        GroupCut(model.config.num_frames),
        genres=genres_of(model),
        energy=listens_to_energy(model),
        augment=augment,
        dancers_per_batch=corpus.dancers_per_batch,
        real=corpus.real,
        swaps=corpus.swaps,
        seed=seed,
    )
