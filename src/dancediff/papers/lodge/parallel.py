r"""Parallel inference: a dance of any length, all of its segments at once.

Read first: Lodge section 3.2 and "Parallel Inference" · `dancediff.papers.lodge.choreography`.

Symbols (axes: g globals · l locals · p primitives · f frames of a local · F frames of the dance
         d motion, m music features)
    M         music features, raw                         (F', m)   F' >= F
    style     one token for each segment                  (g or l, d_model)
    at_once   segments that go through a network together; None: all of them
    first     number of the first of these segments, counted from the song's start

    music -> globals -> primitives -> cues -> locals -> stitched -> cropped

No segment waits for another: neighbours agree because they share halves of hard primitives.
Each segment has its own source of noise, so the dance is the same however they are grouped.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.guidance import guided, off_at_the_end
from dancediff.diffusion.samplers import GuessHook, sample, sampling_times
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.autoguidance import autoguided
from dancediff.extensions.foot_contact_projection import foot_contact_hook
from dancediff.extensions.smooth_primitives import smooth_primitives
from dancediff.motion.representation import LODGE, cut_to_range
from dancediff.music.beats import beat_frames
from dancediff.papers.lodge.choreography import Cues, arrange
from dancediff.papers.lodge.cue_guidance import CueGuidance
from dancediff.papers.lodge.global_diffusion import GlobalDenoiser
from dancediff.papers.lodge.local_diffusion import LocalDenoiser
from dancediff.papers.lodge.primitives import Layout, thinned_primitives
from dancediff.papers.lodge.song_structure import find_sections
from dancediff.papers.lodge.stitch import Plan, plan, stitch

STYLE, GLOBALS, LOCALS, SOFT_CUES = range(4)  # what noise is for


@dataclass(frozen=True)
class Sampling:
    """How both stages are sampled; see `dancediff.diffusion.samplers.sample`."""

    sampler: str = "ddim"
    steps: int = 50
    guidance: float = 2.0
    autoguidance: float = 1.0
    eta: float = 1.0
    seed: int = 0
    at_once: int | None = None
    dtype: torch.dtype | None = None  # torch.bfloat16: half the digits inside the networks

    def __post_init__(self):
        if self.at_once is not None and not (type(self.at_once) is int and self.at_once >= 1):
            raise ValueError(
                f"at_once={self.at_once!r} must be a number of segments from 1 on, or None for all"
            )

    def generators(self, purpose: int, rows: int, first: int = 0) -> list[torch.Generator]:
        """One source of noise for each row; row k is the same whichever others there are.

        >>> how = Sampling(seed=3)
        >>> a, b = how.generators(LOCALS, 9)[4], how.generators(LOCALS, 2, first=4)[0]
        >>> torch.equal(torch.randn(4, generator=a), torch.randn(4, generator=b))
        True
        """
        numbers = range(first, first + rows)
        seeds = (np.random.SeedSequence([self.seed, purpose, k]) for k in numbers)
        states = (int(s.generate_state(1, np.uint64)[0]) >> 1 for s in seeds)
        return [torch.Generator().manual_seed(state) for state in states]

    def chunks(self, rows: int) -> Iterator[slice]:
        """Rows 0 ... rows - 1 in pieces of ``at_once``.

        >>> [(part.start, part.stop) for part in Sampling(at_once=2).chunks(5)]
        [(0, 2), (2, 4), (4, 5)]
        """
        size = self.at_once or max(rows, 1)
        return (slice(start, min(start + size, rows)) for start in range(0, rows, size))

    def times(self, num_steps: int) -> list[int]:
        """The steps that will be taken."""
        return sampling_times(self.sampler, self.steps, cosine_abar(num_steps))

    def calls(self, rows: int, num_steps: int = 1000) -> int:
        """How many steps all chunks take together, for a progress bar.

        >>> Sampling(steps=10, at_once=2).calls(5)
        30
        """
        return len(list(self.chunks(rows))) * (len(self.times(num_steps)) - 1)


def layout_of(stage: GlobalDenoiser) -> Layout:
    """The segments and primitives that a global denoiser was made for."""
    c = stage.config
    stride = c.every if c.variant == "discrete" else 1
    return Layout(c.music_frames, c.local_frames, c.primitive_frames, stride)


def sample_rows(
    model: GlobalDenoiser | LocalDenoiser,
    M: Tensor,
    style: Tensor | None,
    how: Sampling,
    purpose: int,
    *,
    first: int = 0,
    pin: CueGuidance | None = None,
    hooks: Sequence[GuessHook] = (),
    callback: Callable[[], None] | None = None,
) -> Tensor:
    """Sample rows of a stage together; ``callback()`` runs after every step.

    Shapes: M (b, N, m) standardised, style (b, d_model) -> (b, f, d) normalised.
    """
    weight = how.guidance
    if how.sampler == "ddpm":
        weight = off_at_the_end(weight, model.config.num_steps)
    denoise = guided(partial(_guess, model, how.dtype), Conditions(M, style=style), guidance=weight)
    return sample(
        autoguided(denoise, partial(_linear, model), how.autoguidance),
        (len(M), model.config.num_frames, model.config.motion_dim),
        abar=model.abar,
        sampler=how.sampler,
        steps=how.steps,
        eta=how.eta,
        clamp=None if model.config.precondition else cut_to_range,
        generator=how.generators(purpose, len(M), first),
        pin=pin,
        hooks=hooks,
        callback=callback and (lambda i, total, x0_hat: callback()),
        device=model.abar.device,
    )


def _guess(model, dtype, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
    with torch.autocast(x_t.device.type, torch.bfloat16, enabled=dtype == torch.bfloat16):
        return model.denoise(x_t, t, conditions).float()


def _linear(model, x_t: Tensor, t: int) -> Tensor:
    return model.linear_guess(x_t, torch.full((len(x_t),), t, device=x_t.device))


def sample_primitives(
    model: GlobalDenoiser,
    M: Tensor,
    style: Tensor | None,
    how: Sampling,
    *,
    first: int = 0,
    callback: Callable[[], None] | None = None,
) -> Tensor:
    """First stage: the primitives of global segments.

    Shapes: M (g, N, m) raw, style (g, d_model) -> (g, p, 8, d) metres, on the CPU.
    """
    M = model.music_normalizer.normalize(M.to(model.abar.device))
    x = sample_rows(model, M, style, how, GLOBALS, first=first, callback=callback)
    x = model.normalizer.unnormalize(x).cpu()
    if model.config.variant == "continuous":
        return smooth_primitives(model.clips(x))
    return torch.stack([thinned_primitives(part, layout_of(model)) for part in x])


def sample_locals(
    model: LocalDenoiser,
    M: Tensor,
    cues: Cues,
    style: Tensor,
    how: Sampling,
    *,
    first: int = 0,
    soft: float = 1.0,
    home: bool = True,
    feet: str = "planted",
    callback: Callable[[], None] | None = None,
) -> Tensor:
    """Second stage: dance from cue to cue; with ``home`` each segment ends where it began.

    ``feet`` "planted": they stand where the dance says so, but for the frames of hard cues.

    Shapes: M (l, f, m) raw, cues in metres, style (l, d_model) -> (l, f, d) metres, on the CPU.
    Raises: ValueError for ``soft`` outside 0 ... 1.
    """
    cues = cues.normalized(model.normalizer)
    pin = CueGuidance(
        cues.value,
        cues.hard,
        cues.soft,
        model.abar,
        how.times(model.config.num_steps),
        soft=soft,
        channels=cues.channels,
        spread=None if model.spread is None else model.spread.cpu(),
        home=model.normalizer.normalize(cues.value.new_zeros(LODGE.dim)) if home else None,
        generators=how.generators(SOFT_CUES, len(M), first),
    )
    M = model.music_normalizer.normalize(M.to(model.abar.device))
    hooks = [pin]
    if feet == "planted":
        mask = cues.hard.cpu()[..., None].expand_as(cues.value)
        hooks.append(foot_contact_hook(model.normalizer.on_cpu(), mask, LODGE))
    x = sample_rows(
        model, M, style, how, LOCALS, first=first, pin=pin, hooks=hooks, callback=callback
    )
    return model.normalizer.unnormalize(x).cpu()


def style_tokens(stage, genre: int, rows: int, how: Sampling) -> Tensor | None:
    """The same style for all segments: one dancer, one genre; None where a stage knows none.

    Shapes: -> (rows, d_model).
    """
    if stage.style is None:
        return None
    device = stage.abar.device
    z = torch.randn(1, stage.style.noise, generator=how.generators(STYLE, 1)[0]).to(device)
    return stage.style(torch.full((1,), genre, device=device), z).expand(rows, -1)


@torch.no_grad()
def dance(
    global_stage: GlobalDenoiser,
    local_stage: LocalDenoiser,
    M: Tensor,
    frames: int,
    *,
    genre: int,
    how: Sampling | None = None,
    soft: float = 1.0,
    home: bool = True,
    feet: str = "planted",
    mirror: bool = True,
    beat_align: bool = True,
    report: Callable[[int, int], None] | None = None,
) -> Tensor:
    """Both stages, and what lies around and between them.

    ``soft``: share of the steps in which soft cues are held.  ``mirror``, ``beat_align``: see
    `make_cues`.  ``home``: every segment ends where it began, so that a long dance stays on the
    stage; a model without preconditioning cannot be asked to.  ``feet``: "planted" or "free", see
    `dancediff.extensions.foot_contact_projection`.  ``report(done, total)`` counts
    denoising steps.

    Source: Lodge "Parallel Inference".  Differs: songs of any length (`plan`), beats and sections
    of the song place and repeat the cues, and the root goes on over the seams (`stitch`).

    Shapes: M (F', m) raw -> (F, d) metres and 6-D rotations, on the CPU.
    Raises: ValueError for less music than frames, or a value out of range.
    """
    how, layout = how or Sampling(), layout_of(global_stage)
    segments = plan(frames, layout)
    tick = _counter(report, _calls(global_stage, local_stage, segments, how))
    primitives = [
        sample_primitives(
            global_stage,
            segments.global_music(M, part),
            style_tokens(global_stage, genre, part.stop - part.start, how),
            how,
            first=part.start,
            callback=tick,
        )
        for part in how.chunks(len(segments.globals))
    ]
    arrangement = arrange(
        torch.cat(primitives),
        segments,
        beats=beat_frames(M),
        sections=find_sections(M[:frames]),
        mirror=mirror,
        beat_align=beat_align,
    )
    # cues, masks and their normalised copies are many times the dance: of a chunk only
    x = torch.empty(len(segments.locals), layout.local_frames, local_stage.config.motion_dim)
    for part in how.chunks(len(x)):
        x[part] = sample_locals(
            local_stage,
            segments.local_music(M, part),
            arrangement.cues(part),
            style_tokens(local_stage, genre, part.stop - part.start, how),
            how,
            first=part.start,
            soft=soft,
            home=home,
            feet=feet,
            callback=tick,
        )
    return stitch(x)[:frames]


def _calls(global_stage, local_stage, segments: Plan, how: Sampling) -> int:
    stages = ((global_stage, segments.globals), (local_stage, segments.locals))
    return sum(how.calls(len(rows), stage.config.num_steps) for stage, rows in stages)


def _counter(report, total: int) -> Callable[[], None] | None:
    """A function without arguments that reports 1, 2, ... total."""
    if report is None:
        return None
    done = iter(range(1, total + 1))
    return lambda: report(next(done), total)
