r"""From a song and a resolved request to Lodge's solo, danced by one or by a group.

Read first: notebook 12 · `dancediff.papers.lodge.parallel` · `dancediff.papers.lodge.group`.

Symbols (axes: n dancers · F frames of the dance · f frames of a piece · d motion features)
"""

from collections.abc import Iterator

import numpy as np
from torch import Tensor

from dancediff.generation.request import LodgeRequest
from dancediff.genre import genre_number
from dancediff.motion.representation import with_hands
from dancediff.music.beats import beat_frames
from dancediff.papers.lodge.group import PIECE, Group, canon_delays, places
from dancediff.papers.lodge.parallel import Sampling, dance, layout_of
from dancediff.papers.lodge.stitch import plan


def solo_seams(model, song, request: LodgeRequest) -> list[int]:
    """Frames in which somebody passes from one segment to the next."""
    f, delay = request.frames, [0]
    if request.relation == "canon":
        delay = canon_delays(request.dancers, beat_frames(song.features()))
    at = plan(f, layout_of(model.global_stage)).seams
    return sorted({seam + late for seam in at for late in delay if seam + late < f})


def solo_pieces(model, song, request: LodgeRequest, *, report=None, dtype=None) -> Iterator[Tensor]:
    """A minute of the dance at a time, features (n, f, 151) in metres."""
    names = ("sampler", "steps", "guidance", "autoguidance", "eta", "seed", "at_once")
    M = song.features()
    group = Group(
        dance(
            model.global_stage,
            model.local_stage,
            M,
            request.frames,
            genre=genre_number(request.genre, model.config.genres),
            how=Sampling(dtype=dtype, **{name: getattr(request, name) for name in names}),
            soft=request.soft,
            home=request.return_to_origin,
            feet="planted" if request.foot_contact else "free",
            mirror=request.mirror,
            beat_align=request.beat_align,
            report=report,
        ),
        np.asarray(places(request.dancers, request.formation)),
        relation=request.relation,
        delay=canon_delays(request.dancers, beat_frames(M)),
    )
    for start in range(0, request.frames, PIECE):
        yield with_hands(group.frames(start, start + PIECE))
