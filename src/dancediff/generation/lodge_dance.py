r"""From a song and a resolved request to Lodge's solo, danced by one or by a group.

Read first: `dancediff.papers.lodge.parallel`, which is the paper's sampling; here is what we add.

Symbols (axes: b batch · n dancers · F frames of the dance · f frames of a piece · g genres
         d motion features, in a style token channels)
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.samplers import GuessHook
from dancediff.extensions.autoguidance import autoguided, last_pushed, linear_guess_of
from dancediff.extensions.border_smoothing import BorderSmoothing
from dancediff.extensions.energy_condition import has_energy_condition
from dancediff.extensions.foot_contact_projection import foot_contact_hook
from dancediff.extensions.group_relations import PIECE, Group, canon_delays, places
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.extensions.repeat_sections import find_sections, repeat_sections
from dancediff.extensions.root_stitching import root_stitching
from dancediff.extensions.smooth_primitives import smooth_primitives
from dancediff.extensions.stage_spots import stage_spots, stage_spots_hook
from dancediff.generation.energy_option import energy_for
from dancediff.generation.genre_mix import mix_weights
from dancediff.generation.lodge_request import LodgeRequest
from dancediff.motion.representation import LODGE, at_origin, with_hands
from dancediff.music.features import beat_frames
from dancediff.papers.lodge.choreography import Arrangement
from dancediff.papers.lodge.cue_guidance import CueGuidance
from dancediff.papers.lodge.parallel import ParallelSampler
from dancediff.papers.lodge.segments import Segments, segments_of
from dancediff.papers.lodge.style import StyleToken


class LodgeSampler(ParallelSampler):
    """The paper's sampler, with those additions that a resolved `LodgeRequest` asks for."""

    energy: Tensor | None = None  # of the song (F',)

    @torch.no_grad()
    def dance(self, M: Tensor, frames: int) -> Tensor:
        """The energy that is asked for is that of the whole song."""
        if self.request.energy is not None:
            self.energy = energy_for(self.request.energy, M)
        self.segments = segments_of(frames, self.global_stage.config.layout)
        return super().dance(M, frames)

    def conditions(self, stage, M: Tensor, first: int) -> Conditions:
        """With the energy of each row."""
        made = super().conditions(stage, M, first)
        if self.energy is None or not has_energy_condition(stage):
            return made
        segments, part = self.segments, slice(first, first + len(M))
        cut = segments.global_music if stage is self.global_stage else segments.local_music
        return replace(made, energy=cut(self.energy, part).to(M.device))

    def token(self, style: StyleToken, z: Tensor) -> Tensor:
        """A mix of genres is that of their style tokens."""
        genre = self.request.genre
        if isinstance(genre, str):
            return super().token(style, z)
        weights = mix_weights(genre, self.local_stage.config.genres).to(z)
        return torch.einsum("bg,bgd->bd", weights, style.mapping(z))

    def primitives(self, M: Tensor, segments: Segments) -> Tensor:
        """Without jitter."""
        primitives = super().primitives(M, segments)
        smooth = self.request.smooth_primitives
        if smooth and self.global_stage.config.variant == "continuous":
            return smooth_primitives(primitives)
        return primitives

    def arrange(self, primitives: Tensor, M: Tensor, segments: Segments) -> Arrangement:
        """What comes again in the song comes again in the dance."""
        made = super().arrange(primitives, M, segments)
        if not self.request.repeat_sections:
            return made
        sections = find_sections(M[: segments.frames])
        return repeat_sections(made, segments, sections, mirror=self.request.mirror)

    def hooks(self, pin: CueGuidance, first: int) -> Sequence[GuessHook]:
        """Segments end at their spots, cues are met without a jerk, feet stand."""
        stage, request, hooks = self.local_stage, self.request, list[GuessHook]()
        preconditioning, normalizer = preconditioning_of(stage), stage.normalizer.on_cpu()
        if preconditioning is not None:
            std = preconditioning.std
            if request.stage_spots:
                spots = stage_spots(request.seed, len(pin.y), first)
                hooks.append(stage_spots_hook(spots, pin.y.shape[1], normalizer, std))
            if request.border_smoothing:
                hooks.append(BorderSmoothing(pin.hard.cpu(), pin.y.cpu(), pin.hard_frames.cpu()))
        if request.foot_contact:
            mask = pin.hard_frames.cpu()[..., None].expand(pin.y.shape)
            hooks.append(foot_contact_hook(normalizer, mask, LODGE))
        return hooks

    def guess(self, stage, conditions: Conditions) -> Callable[[Tensor, int], Tensor]:
        """Pushed away from the linear guess."""
        denoise = super().guess(stage, conditions)
        if self.request.autoguidance == 1:
            return denoise
        return autoguided(
            denoise,
            linear_guess_of(stage, conditions),
            self.request.autoguidance,
            last=last_pushed(stage.abar, self.request.autoguidance_end),
        )

    def clamp(self, stage) -> Callable[[Tensor], Tensor] | None:
        """Preconditioned guesses are not cut."""
        return super().clamp(stage) if preconditioning_of(stage) is None else None

    def join(self, x: Tensor) -> Tensor:
        """The root goes on over seams."""
        return root_stitching(x) if self.request.root_stitching else super().join(x)


def lodge_pieces(
    model, song, request: LodgeRequest, *, report=None, dtype=None
) -> Iterator[Tensor]:
    """A minute of the dance at a time, for all dancers: features (n, f, 151) in metres.

    The solo is made first: 139 numbers a frame, 60 MB an hour, are held to its end. Everything
    else, above all the other dancers, is made for a piece only.
    """
    M = song.features()
    stages = (model.global_stage, model.local_stage)
    sampler = LodgeSampler(*stages, request, report=report, dtype=dtype)
    solo = at_origin(sampler.dance(M, request.frames))
    if request.dancers == 1:
        pieces = iter(solo[None].split(PIECE, dim=1))
    else:
        group = Group(
            solo,
            np.asarray(places(request.dancers, request.formation)),
            relation=request.relation,
            delay=canon_delays(request.dancers, beat_frames(M)),
        )
        starts = range(0, request.frames, PIECE)
        pieces = (group.frames(start, start + PIECE) for start in starts)
    yield from map(with_hands, pieces)


def lodge_seams(model, song, request: LodgeRequest) -> list[int]:
    """Frames in which somebody passes from one segment to the next."""
    delay = [0]
    if request.relation == "canon":
        delay = canon_delays(request.dancers, beat_frames(song.features()))
    at = segments_of(request.frames, model.config.global_stage.layout).seams
    return sorted({seam + late for seam in at for late in delay if seam + late < request.frames})
