"""What the variants of an ablation learn from, and what they are measured on.

TCDiff++ and EDGE learn groups, Lodge learns solos, of the same choreographed songs
(`dancediff.data.choreographed`), unless the config names a prepared folder.
"""

from pathlib import Path

from dancediff.data.choreographed import (
    choreographed_corpus,
    choreographed_takes,
    genre_and_tempo,
)
from dancediff.data.take import DanceTake
from dancediff.genre import GENRES
from dancediff.motion.motion import Motion
from dancediff.motion.representation import LODGE
from dancediff.music.synth import synth_song
from dancediff.training.ablation_config import Variant
from dancediff.training.lodge import is_lodge
from dancediff.training.lodge_data import choreographed_solos, prepared_solos
from dancediff.training.run import MODELS, prepared_takes


def corpus(variant: Variant, out: Path) -> list[DanceTake]:
    """The training set; what is choreographed for it is kept in ``out/songs``."""
    data, lodge = variant.tables["data"], is_lodge(variant.tables)
    genres = tuple(variant.tables["local_stage"].get("genres", GENRES)) if lodge else ()
    if "folder" in data and lodge:
        return prepared_solos(data["folder"], genres)
    if "folder" in data:
        kind = MODELS[variant.tables["model"].get("class", "TCDiffPP")][1]
        sizes = {k: v for k, v in variant.tables["model"].items() if k != "class"}
        return prepared_takes(data["folder"], kind(**sizes))
    seeds = range(data["first_seed"], data["first_seed"] + data["songs"])
    options = {"workers": data.get("workers", 2), "cache": out / "songs"}
    if lodge:
        return choreographed_solos(seeds, data["seconds"], genres, **options)
    return choreographed_corpus(seeds, seconds=data["seconds"], **options)


def held_out_songs(variant: Variant) -> list:
    """The `Music` that every variant dances to."""
    seconds = variant.held_out.seconds
    return [
        synth_song(seed, seconds=seconds, tempo=genre_and_tempo(seed)[1])[0]
        for seed in _seeds(variant)
    ]


def held_out_genres(variant: Variant) -> list[str]:
    """The genre that each of those songs was made for; only Lodge takes one."""
    return [genre_and_tempo(seed)[0] for seed in _seeds(variant)]


def held_out_dances(variant: Variant) -> list[Motion]:
    """The choreographer's dances to those songs."""
    size = 1 if is_lodge(variant.tables) else variant.held_out.dancers
    options = {"seconds": variant.held_out.seconds, "sizes": (size,)}
    return [
        take.motion for seed in _seeds(variant) for take in choreographed_takes(seed, **options)
    ]


def reference_dances(variant: Variant, takes: list[DanceTake]) -> list[Motion]:
    """Dances of the training set, as long as those of the variants."""
    held_out, lodge = variant.held_out, is_lodge(variant.tables)
    frames = round(30 * held_out.seconds)
    size = 1 if lodge else held_out.dancers
    fitting = [
        take.x[:, :frames]
        for take in takes
        if take.num_dancers == size and (not lodge or take.num_frames >= frames)
    ][: held_out.reference]
    if lodge:
        return [Motion.from_features(x[..., : LODGE.dim], name="lodge") for x in fitting]
    return [Motion.from_features(x) for x in fitting]


def _seeds(variant: Variant) -> range:
    first = variant.held_out.first_seed
    return range(first, first + variant.held_out.songs)
