"""What the variants of an ablation learn from, and what they are measured on.

TCDiff++ and EDGE learn groups, Lodge learns solos, of the same choreographed songs
(`dancediff.data.choreographed`), unless the config names a prepared folder.
"""

from pathlib import Path

from dancediff.axes import FPS
from dancediff.data.choreographed import choreographed_takes, genre_and_tempo
from dancediff.data.take import DanceTake
from dancediff.motion.motion import Motion
from dancediff.motion.representation import LODGE
from dancediff.music.song import Music
from dancediff.music.synth import synth_song
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.training.ablation_config import Variant
from dancediff.training.config import GroupData, SoloData
from dancediff.training.group_takes import takes_for
from dancediff.training.lodge import is_lodge, solos_for
from dancediff.training.run import MODELS, NAMES


def corpus(variant: Variant, out: Path) -> list[DanceTake]:
    """The training set; what is choreographed for it is kept in ``out/songs``."""
    data, tables = variant.tables["data"], variant.tables
    if is_lodge(tables):
        genres = LocalConfig(**tables["local_stage"]).genres
        return solos_for(SoloData(**data), None, genres, out / "songs")
    model = tables["model"]
    sizes = {key: value for key, value in model.items() if key not in ("class", *NAMES)}
    kind = MODELS[tables["model"].get("class", "TCDiffPP")][1]
    return takes_for(GroupData(**data), None, kind(**sizes), cache=out / "songs")[0]


def held_out_songs(variant: Variant) -> list[Music]:
    """The songs that every variant dances to."""
    seconds = variant.held_out.seconds
    return [
        synth_song(seed, seconds=seconds, tempo=genre_and_tempo(seed)[1])[0]
        for seed in variant.held_out.seeds
    ]


def held_out_genres(variant: Variant) -> list[str]:
    """The genre that each of those songs was made for; only Lodge takes one."""
    return [genre_and_tempo(seed)[0] for seed in variant.held_out.seeds]


def held_out_dances(variant: Variant) -> list[Motion]:
    """The choreographer's dances to those songs."""
    size = 1 if is_lodge(variant.tables) else variant.held_out.dancers
    seconds = variant.held_out.seconds
    return [
        take.motion
        for seed in variant.held_out.seeds
        for take in choreographed_takes(seed, seconds=seconds, sizes=(size,))
    ]


def reference_dances(variant: Variant, takes: list[DanceTake]) -> list[Motion]:
    """Dances of the training set, as long as those of the variants."""
    held_out, lodge = variant.held_out, is_lodge(variant.tables)
    frames = round(FPS * held_out.seconds)
    size = 1 if lodge else held_out.dancers
    fitting = [
        take.x[:, :frames]
        for take in takes
        if take.num_dancers == size and (not lodge or take.num_frames >= frames)
    ][: held_out.reference]
    if lodge:
        return [Motion.from_features(x[..., : LODGE.dim], name="lodge") for x in fitting]
    return [Motion.from_features(x) for x in fitting]
