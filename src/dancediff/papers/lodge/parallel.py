r"""Parallel inference: a dance of any length, all of its segments at once.

Read first: Lodge section 3.2 and "Parallel Inference" · `dancediff.papers.lodge.choreography`.

Symbols (axes: g globals · l locals · p primitives · f frames of a local · F frames of the dance
         d motion, m music features)
    M         music features, raw                         (F', m)   F' >= F
    first     number of the first of the segments in hand, counted from the song's start

    music -> primitives -> arrangement -> cues -> locals -> one after the other

No segment waits for another: they agree because they share halves of hard primitives.
Each segment has its own source of noise, so the dance is the same however they are grouped.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.guidance import guided, off_at_the_end
from dancediff.diffusion.samplers import GuessHook, SamplerOptions, sample, sampling_times
from dancediff.genre import genre_number
from dancediff.motion.representation import cut_to_range
from dancediff.music.features import dance_frames
from dancediff.papers.lodge.choreography import Arrangement, Cues, arrange
from dancediff.papers.lodge.cue_guidance import CueGuidance
from dancediff.papers.lodge.global_diffusion import GlobalDenoiser
from dancediff.papers.lodge.local_diffusion import LocalDenoiser
from dancediff.papers.lodge.primitives import thinned_primitives
from dancediff.papers.lodge.segments import Segments, segments_of
from dancediff.papers.lodge.style import StyleToken

STYLE, GLOBALS, LOCALS, SOFT_CUES = range(4)  # what noise is for


def row_generators(seed: int, purpose: int, rows: int, first: int = 0) -> list[torch.Generator]:
    """One source of noise for each row; row k is the same whichever others there are.

    >>> a, b = row_generators(3, LOCALS, 9)[4], row_generators(3, LOCALS, 2, first=4)[0]
    >>> torch.equal(torch.randn(4, generator=a), torch.randn(4, generator=b))
    True
    """
    seeds = (np.random.SeedSequence([seed, purpose, k]) for k in range(first, first + rows))
    states = (int(s.generate_state(1, np.uint64)[0]) >> 1 for s in seeds)
    return [torch.Generator().manual_seed(state) for state in states]


def chunks(rows: int, at_once: int | None) -> Iterator[slice]:
    """Rows 0 ... rows - 1 in pieces of ``at_once``; None: all in one.

    >>> [(part.start, part.stop) for part in chunks(5, 2)]
    [(0, 2), (2, 4), (4, 5)]
    """
    size = at_once or max(rows, 1)
    return (slice(start, min(start + size, rows)) for start in range(0, rows, size))


class ParallelSampler:
    r"""The steps from music to dance, one method each.

    ``request`` has what is asked for: sampler, steps, eta, sigma_min, guidance, seed, genre, soft,
    mirror, beat_align, and at_once, the number of segments that go through a network together, or
    None. ``dtype``: torch.bfloat16 for half the digits inside the networks. ``report(done, total)``
    counts denoising steps.

    Source: Lodge "Parallel Inference".  Differs: songs of any length (`segments_of`).

    Shapes: see the methods; everything between the stages is in metres, on the CPU.
    """

    def __init__(
        self,
        global_stage: GlobalDenoiser,
        local_stage: LocalDenoiser,
        request,
        *,
        dtype: torch.dtype | None = None,
        report: Callable[[int, int], None] | None = None,
    ):
        """Nothing is sampled yet."""
        self.global_stage, self.local_stage, self.request = global_stage, local_stage, request
        self.half = dtype == torch.bfloat16
        self.report, self.done, self.total = report, 0, 0

    @torch.no_grad()
    def dance(self, M: Tensor, frames: int) -> Tensor:
        """All steps in turn.

        Shapes: M (F', m) -> (F, d).  Raises: ValueError for less music than frames.
        """
        segments = segments_of(frames, self.global_stage.config.layout)
        self.total = self._steps(len(segments.globals)) + self._steps(len(segments.locals))
        arrangement = self.arrange(self.primitives(M, segments), M, segments)
        return self.join(self.locals(M, segments, arrangement))[:frames]

    def primitives(self, M: Tensor, segments: Segments) -> Tensor:
        """First stage: the primitives of all globals.

        Shapes: M (F', m) -> (g, p, 8, d).
        """
        stage = self.global_stage
        x = torch.cat(
            [
                self.sample(stage, GLOBALS, segments.global_music(M, part), part.start)
                for part in chunks(len(segments.globals), self.request.at_once)
            ]
        )
        if stage.config.variant == "continuous":
            return stage.clips(x)
        return torch.stack([thinned_primitives(part, segments.layout) for part in x])

    def arrange(self, primitives: Tensor, M: Tensor, segments: Segments) -> Arrangement:
        """Which primitives each local passes, and when."""
        beats = dance_frames(M) if self.request.beat_align else ()
        return arrange(primitives, segments, beats=beats, mirror=self.request.mirror)

    def locals(self, M: Tensor, segments: Segments, arrangement: Arrangement) -> Tensor:
        """Second stage: dance from cue to cue.

        Shapes: M (F', m) -> (l, f, d).
        """
        shape = (len(segments.locals), segments.layout.local_frames)
        x = torch.empty(*shape, self.local_stage.config.motion_dim)
        # cues, masks and their normalised copies are many times the dance: of a chunk only
        for part in chunks(len(x), self.request.at_once):
            music = segments.local_music(M, part)
            x[part] = self.locals_between(arrangement.cues(part), music, part.start)
        return x

    def locals_between(self, cues: Cues, music: Tensor, first: int) -> Tensor:
        """Some locals, given their cues: (l, f, m) -> (l, f, d)."""
        stage = self.local_stage
        cues = cues.normalized(stage.normalizer)
        pin = CueGuidance(
            cues.value,
            cues.hard,
            cues.soft,
            stage.abar,
            self.times(stage),
            soft=self.request.soft,
            generators=row_generators(self.request.seed, SOFT_CUES, len(music), first),
        )
        return self.sample(stage, LOCALS, music, first, pin=pin, hooks=self.hooks(pin, first))

    def hooks(self, pin: CueGuidance, first: int) -> Sequence[GuessHook]:
        """What else happens to the guesses of locals: nothing in the paper."""
        return ()

    def join(self, x: Tensor) -> Tensor:
        """Locals one after the other: (l, f, d) -> (F, d)."""
        return x.flatten(0, 1)

    def sample(
        self,
        stage: GlobalDenoiser | LocalDenoiser,
        purpose: int,
        music: Tensor,
        first: int,
        *,
        pin: CueGuidance | None = None,
        hooks: Sequence[GuessHook] = (),
    ) -> Tensor:
        """Sample rows of a stage together, of the segments from number ``first`` on.

        Shapes: music (b, N, m) raw -> (b, f, d).
        """
        request, rows = self.request, len(music)
        M = stage.music_normalizer.normalize(music.to(stage.abar.device))
        x = sample(
            self.guess(stage, self.conditions(stage, M, first)),
            (rows, stage.config.num_frames, stage.config.motion_dim),
            SamplerOptions(
                stage.abar,
                request.sampler,
                request.steps,
                request.eta,
                clamp=self.clamp(stage),
                sigma_min=request.sigma_min,
            ),
            generator=row_generators(request.seed, purpose, rows, first),
            pin=pin,
            hooks=hooks,
            callback=self._tick,
        )
        return stage.normalizer.unnormalize(x).cpu()

    def conditions(self, stage, M: Tensor, first: int) -> Conditions:
        """What the network is given with the music (b, N, m) of rows from number ``first`` on."""
        return Conditions(M, style=self.style(stage, len(M)))

    def guess(self, stage, conditions: Conditions) -> Callable[[Tensor, int], Tensor]:
        """The stage with classifier-free guidance, as a function of x_t and t."""
        weight = self.request.guidance
        if self.request.sampler == "ddpm":
            weight = off_at_the_end(weight, stage.config.num_steps)

        def denoise(x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
            with torch.autocast(x_t.device.type, torch.bfloat16, enabled=self.half):
                return stage.denoise(x_t, t, conditions).float()

        return guided(denoise, conditions, weight)

    def clamp(self, stage) -> Callable[[Tensor], Tensor] | None:
        """Where guesses are cut."""
        return cut_to_range

    def style(self, stage, rows: int) -> Tensor | None:
        """The same style for all segments: one dancer, one genre; (rows, d_model), or None."""
        if stage.style is None:
            return None
        generator = row_generators(self.request.seed, STYLE, 1)[0]
        z = torch.randn(1, stage.style.noise, generator=generator)
        return self.token(stage.style, z.to(stage.abar.device)).expand(rows, -1)

    def token(self, style: StyleToken, z: Tensor) -> Tensor:
        """The style token of the genre that is asked for, (1, z) -> (1, d_model)."""
        number = genre_number(self.request.genre, self.local_stage.config.genres)
        return style(torch.full((1,), number, device=z.device), z)

    def times(self, stage) -> list[int]:
        """The steps that will be taken."""
        request = self.request
        return sampling_times(request.sampler, request.steps, stage.abar.cpu(), request.sigma_min)

    def _steps(self, rows: int) -> int:
        """How many denoising steps all chunks take together."""
        steps = len(self.times(self.local_stage)) - 1
        return steps * len(list(chunks(rows, self.request.at_once)))

    def _tick(self, *progress) -> None:
        self.done += 1
        if self.report is not None:
            self.report(self.done, self.total)
