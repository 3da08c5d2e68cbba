"""What the variants of an ablation learn from, and what they are measured on.

TCDiff++ and EDGE learn groups of one style (`dancediff.data.corpus`), Lodge learns solos of every
genre (`dancediff.data.choreographed`), unless the config names a prepared folder.
"""

from pathlib import Path

from dancediff.data.choreographed import choreograph_jobs, genre_and_tempo
from dancediff.data.corpus import choreographed_corpus, choreographed_takes
from dancediff.data.windows import Take
from dancediff.genre import GENRES
from dancediff.motion.motion import Motion
from dancediff.music.synth import synth_song
from dancediff.training.ablation_config import Variant
from dancediff.training.lodge import is_lodge
from dancediff.training.lodge_data import Solo, prepared_solos, solos_of
from dancediff.training.run import MODELS, prepared_takes


def corpus(variant: Variant, out: Path) -> list[Take] | list[Solo]:
    """The training set; what is choreographed for it is kept in ``out/songs``, but for solos."""
    data = variant.tables["data"]
    if is_lodge(variant.tables):
        genres = tuple(variant.tables["local_stage"].get("genres", GENRES))
        if "folder" in data:
            return prepared_solos(data["folder"], genres)
        return solos_of(_solo_takes(data["first_seed"], data["songs"], data["seconds"]), genres)
    if "folder" in data:
        kind = MODELS[variant.tables["model"].get("class", "TCDiffPP")][1]
        sizes = {k: v for k, v in variant.tables["model"].items() if k != "class"}
        return prepared_takes(data["folder"], kind(**sizes))
    seeds = range(data["first_seed"], data["first_seed"] + data["songs"])
    return choreographed_corpus(
        seeds, seconds=data["seconds"], workers=data.get("workers", 2), cache=out / "songs"
    )


def held_out_songs(variant: Variant) -> list:
    """The `Music` that every variant dances to."""
    seconds = variant.held_out.seconds
    if is_lodge(variant.tables):
        tempos = (genre_and_tempo(seed)[1] for seed in _seeds(variant))
        return [
            synth_song(seed, seconds=seconds, tempo=tempo)[0]
            for seed, tempo in zip(_seeds(variant), tempos, strict=True)
        ]
    return [synth_song(seed, seconds=seconds)[0] for seed in _seeds(variant)]


def held_out_genres(variant: Variant) -> list[str]:
    """The genre that each of those songs was made for; only Lodge takes one."""
    return [genre_and_tempo(seed)[0] for seed in _seeds(variant)]


def held_out_dances(variant: Variant) -> list[Motion]:
    """The choreographer's dances to those songs."""
    held_out = variant.held_out
    if is_lodge(variant.tables):
        takes = _solo_takes(held_out.first_seed, held_out.songs, held_out.seconds)
        return [take.motion for take in takes]
    options = {"seconds": held_out.seconds, "sizes": (held_out.dancers,)}
    takes = [take for seed in _seeds(variant) for take in choreographed_takes(seed, **options)]
    return [Motion.from_features(take.x) for take in takes]


def reference_dances(variant: Variant, takes: list[Take] | list[Solo]) -> list[Motion]:
    """Dances of the training set, as long as those of the variants."""
    held_out = variant.held_out
    frames = round(30 * held_out.seconds)
    if is_lodge(variant.tables):
        long = [solo for solo in takes if len(solo.x) >= frames]
        chosen = long[: held_out.reference]
        return [Motion.from_features(solo.x[None, :frames], name="lodge") for solo in chosen]
    fitting = [take for take in takes if take.num_dancers == held_out.dancers]
    return [Motion.from_features(take.x[:, :frames]) for take in fitting[: held_out.reference]]


def _solo_takes(first_seed: int, songs: int, seconds: float) -> list:
    jobs = choreograph_jobs(songs, seed=first_seed, seconds=seconds, sizes=(1,), share=0.0)
    return [job.make() for job in jobs]


def _seeds(variant: Variant) -> range:
    first = variant.held_out.first_seed
    return range(first, first + variant.held_out.songs)
