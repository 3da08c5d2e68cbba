r"""How Lodge's solo is asked for and put on a stage, and what the dance says of that.

Read first: notebook 12 · `dancediff.papers.lodge.parallel` · `dancediff.papers.lodge.group`.

Symbols (axes: n dancers · F frames of the dance · f frames of a piece · d motion features)
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from dancediff.generation.generate import facts_of
from dancediff.generation.request import Wish, one_of
from dancediff.genre import GENRES, genre_for, genre_number
from dancediff.motion.representation import with_hands
from dancediff.music.beats import beat_frames
from dancediff.papers.lodge.cue_guidance import guided_steps
from dancediff.papers.lodge.group import PIECE, RELATIONS, Group, canon_delays, places
from dancediff.papers.lodge.parallel import Sampling, dance, layout_of
from dancediff.papers.lodge.stitch import plan

AUTOGUIDANCE = 1.3  # more makes dances too varied: docs/asked_for_indian.md


@dataclass
class Staging:
    """The arguments of `Lodge.generate` that no other model has, checked.

    Raises: ValueError naming the argument, its value and what is allowed.

    >>> Staging(soft=2)
    Traceback (most recent call last):
    ValueError: soft=2.0 must lie in 0 (hard cues only) ... 1 (all steps but one)
    """

    genre: str | None = None
    soft: float = 1.0
    home: bool = True
    mirror: bool = True
    beat_align: bool = True
    at_once: int | None = 16
    formation: str = "line"
    relation: str = "unison"
    genres: tuple[str, ...] = GENRES

    def __post_init__(self):
        if self.genre is not None:
            genre_number(self.genre, self.genres)
        self.soft = _share(self.soft)
        for name in ("home", "mirror", "beat_align"):
            setattr(self, name, bool(getattr(self, name)))
        Sampling(at_once=self.at_once)  # refuses what is no number of segments
        one_of("relation", self.relation, RELATIONS)

    def genre_of(self, song) -> str:
        """The genre that was asked for, or the one that goes with the song's tempo."""
        return self.genre or genre_for(song.tempo, self.genres)


def describe(model, song, wish: Wish, *, staging: Staging) -> dict:
    """What a dance says of how it was made, for ``Motion.meta``."""
    facts = facts_of(model, song, wish)
    for name in ("overlap", "pinning"):  # of other ways to make long dances
        facts.pop(name)
    told = ("soft", "home", "mirror", "beat_align")
    facts |= {"genre": staging.genre_of(song)} | {name: getattr(staging, name) for name in told}
    facts["seams"] = _seams(model, song, wish, staging.relation)
    if wish.dancers > 1:
        facts |= {"formation": staging.formation, "relation": staging.relation}
    return facts


def _seams(model, song, wish: Wish, relation: str) -> list[int]:
    """Frames in which somebody passes from one segment to the next."""
    f, delay = wish.frames, [0]
    if relation == "canon":
        delay = canon_delays(wish.dancers, beat_frames(song.features()))
    at = plan(f, layout_of(model.global_stage)).seams
    return sorted({seam + late for seam in at for late in delay if seam + late < f})


def draw_group(model, song, wish: Wish, **how) -> Tensor:
    """The ``draw`` of `dancediff.generation.generate.generate`: features (n, F, 151) in metres."""
    return torch.cat(list(draw_pieces(model, song, wish, **how)), dim=1)


def draw_pieces(
    model, song, wish: Wish, *, staging: Staging, report=None, dtype=None
) -> Iterator[Tensor]:
    """The ``draw`` of `dancediff.generation.generate.stream`: a minute at a time, (n, f, 151).

    Raises: ValueError for a formation that the dancers do not know.
    """
    slots = np.asarray(places(wish.dancers, staging.formation))
    if wish.autoguidance is None:
        wish.autoguidance = AUTOGUIDANCE if model.config.precondition else 1.0
    sampling = ("sampler", "steps", "guidance", "autoguidance", "eta", "seed")
    how = Sampling(at_once=staging.at_once, dtype=dtype)
    M = song.features()
    group = Group(
        dance(
            model.global_stage,
            model.local_stage,
            M,
            wish.frames,
            genre=genre_number(staging.genre_of(song), model.config.genres),
            how=replace(how, **{name: getattr(wish, name) for name in sampling}),
            soft=staging.soft,
            home=staging.home,
            feet=wish.feet,
            mirror=staging.mirror,
            beat_align=staging.beat_align,
            report=report,
        ),
        slots,
        relation=staging.relation,
        delay=canon_delays(wish.dancers, beat_frames(M)),
    )
    for start in range(0, wish.frames, PIECE):
        yield with_hands(group.frames(start, start + PIECE))


def _share(soft) -> float:
    try:
        soft = float(soft)
    except (TypeError, ValueError):
        raise ValueError(f"soft={soft!r} must be a number in 0 ... 1") from None
    guided_steps([0, -1], soft)  # refuses what is out of range
    return soft
