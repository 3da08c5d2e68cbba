"""What the variants of an ablation learn from, and what they are measured on.

Lodge learns solos, all other models learn groups (EDGE each dancer alone), of the same songs
(`dancediff.data.choreographed`), unless the config names a prepared folder.
"""

from functools import partial
from pathlib import Path

from dancediff.data.choreographed import choreographed_takes, genre_and_tempo
from dancediff.data.take import DanceTake
from dancediff.motion.motion import Motion
from dancediff.motion.order import swap_mode
from dancediff.music.song import Music
from dancediff.music.synth import synth_song
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.training.ablation_config import Variant
from dancediff.training.config import GroupData, SoloData
from dancediff.training.group_takes import takes_for
from dancediff.training.lodge import is_lodge, solos_for
from dancediff.training.run import NAMES, network_classes


def corpus(variant: Variant, out: Path) -> list[DanceTake]:
    """The training set; what is choreographed for it is kept in ``out/songs``."""
    data, tables = variant.tables["data"], variant.tables
    if is_lodge(tables):
        genres = LocalConfig(**tables["local_stage"]).genres
        return solos_for(SoloData(**data), None, genres, out / "songs")
    model = tables["model"]
    sizes = {key: value for key, value in model.items() if key not in ("class", *NAMES)}
    _, config_class = network_classes(model.get("class", "TCDiffPP"))
    return takes_for(GroupData(**data), None, config_class(**sizes), cache=out / "songs")


def held_out_songs(variant: Variant) -> list[Music]:
    """The songs that every variant dances to."""
    seconds = variant.held_out.seconds
    return [
        synth_song(seed, seconds=seconds, tempo=genre_and_tempo(seed)[1])[0]
        for seed in variant.held_out.seeds
    ]


def held_out_genres(variant: Variant) -> list[str]:
    """The genre that each of those songs was made for, of which models without genres take none."""
    return [genre_and_tempo(seed)[0] for seed in variant.held_out.seeds]


def held_out_dances(variant: Variant) -> list[Motion]:
    """The choreographer's dances to those songs."""
    return _choreographed(variant, variant.held_out.seeds)


def reference_dances(variant: Variant) -> list[Motion]:
    """Choreographed dances to as many other new songs, which dances are compared with by FID etc.

    As long and as large as those of the variants: a part of a longer dance would not do. In the
    first five seconds of half a minute hardly anybody changes places, in a dance of five seconds
    many do.
    """
    return _choreographed(variant, variant.held_out.reference_seeds)


def held_out_orders(variant: Variant) -> list[tuple[int, ...]]:
    """The order in which each choreographed dance ends, as group models are asked for it."""
    ends = [dance.root[:, :: dance.num_frames - 1, 0] for dance in held_out_dances(variant)]
    return [tuple(swap_mode(x[:, 0], x[:, 1]).tolist()) for x in ends]


def _choreographed(variant: Variant, seeds: range) -> list[Motion]:
    size = 1 if is_lodge(variant.tables) else variant.held_out.dancers
    make = partial(choreographed_takes, seconds=variant.held_out.seconds, sizes=(size,))
    return [take.motion for seed in seeds for take in make(seed)]
