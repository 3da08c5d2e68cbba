"""What models of groups learn from: takes of a prepared folder or choreographed ones; windows."""

import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from dancediff.data.augment import Augmentation
from dancediff.data.choreographed import choreographed_corpus
from dancediff.data.packed import PackedTakes
from dancediff.data.prepared import Entry, PreparedData
from dancediff.data.take import DanceTake
from dancediff.data.windows import GroupCut, WindowSampler
from dancediff.extensions.energy_condition import has_energy_condition
from dancediff.extensions.genre_condition import genres_of
from dancediff.training.config import GroupData


def prepared_takes(folder, sizes, split: str = "train") -> list[DanceTake]:
    """Takes of a prepared folder that a model of these sizes can learn from: long and small enough.

    Warns: of those to train on that are left out.
    Raises: ValueError when the folder is not prepared, or has no take to train on.
    """
    most = getattr(sizes, "max_dancers", 5)
    data = PreparedData(folder)
    takes = PackedTakes(data, split).takes(num_frames=sizes.num_frames, max_dancers=most)
    text = f"{str(folder)!r} has no take in {split!r} with music, {sizes.num_frames} frames and at "
    text += f"most {most} dancers; prepare more data"
    if not takes and split == "train":
        raise ValueError(text)
    if split == "train":
        _tell_left_out(data.split(split), sizes.num_frames, most)
    if not takes:
        warnings.warn(f"{text}, or leave evaluate_every out: there is no validation", stacklevel=4)
    return takes


def _tell_left_out(entries: list[Entry], least: int, most: int) -> None:
    reasons = {
        "without music": sum(not entry.songs for entry in entries),
        f"shorter than {least} frames": sum(entry.frames < least for entry in entries),
        f"of more than {most} dancers": sum(entry.dancers > most for entry in entries),
    }
    if any(reasons.values()):
        said = ", ".join(f"{count} {why}" for why, count in reasons.items() if count)
        warnings.warn(f"of {len(entries)} takes to train on are left out: {said}", stacklevel=5)


def solos_of(takes: list[DanceTake]) -> list[DanceTake]:
    """Every dancer alone, in the middle of the stage."""
    return [solo for take in takes for solo in take.solos(centred=True)]


def tell_other_genres(takes: Sequence[DanceTake], genres: Sequence[str], so: str) -> None:
    """Warn of takes whose genre the config does not name, and what becomes of them."""
    other = Counter(take.genre or "none told" for take in takes if take.genre not in genres)
    if other:
        named = ", ".join(f"{genre} ({count})" for genre, count in other.most_common(8))
        text = f"{other.total()} of {len(takes)} takes are {so}, because `genres` in the config"
        warnings.warn(f"{text} lacks theirs: {named}", stacklevel=4)


def takes_for(corpus: GroupData, folder, sizes, *, cache: Path | None = None) -> list[DanceTake]:
    """Takes to learn from: of a prepared folder, else choreographed."""
    if folder := folder or corpus.folder:
        return prepared_takes(folder, sizes)
    return _choreographed(corpus, range(corpus.songs), cache)


def held_out_takes(corpus: GroupData, folder, sizes) -> list[DanceTake]:
    """Takes to evaluate a model of groups on, whatever it learns from.

    ``folder``, else that of ``corpus``: a prepared folder, of which it is the validation split;
    else choreographed dances to songs after those that training would have.
    """
    if folder := folder or corpus.folder:
        return prepared_takes(folder, sizes, "val")
    return _choreographed(corpus, range(corpus.songs, corpus.songs + corpus.held_out))


def _choreographed(corpus: GroupData, songs: range, cache: Path | None = None) -> list[DanceTake]:
    return choreographed_corpus(
        songs, seconds=corpus.seconds, varied=corpus.varied, workers=corpus.workers, cache=cache
    )


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
        energy=has_energy_condition(model),
        augment=augment,
        dancers_per_batch=corpus.dancers_per_batch,
        real=corpus.real,
        swaps=corpus.swaps,
        seed=seed,
    )
