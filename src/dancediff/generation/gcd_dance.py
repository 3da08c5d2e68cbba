"""From a song and a resolved request to a dance of GCD.

Read first: `dancediff.papers.gcd.long_sampling` · `dancediff.generation.segmented_dance`.

Symbols (axes: n dancers · f frames of a segment · F frames of the dance · k segments · d motion)
"""

from collections.abc import Callable

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.samplers import sampling_times
from dancediff.generation.all_segments import in_parts, sample_all
from dancediff.generation.guided_denoiser import GuidedDenoiser
from dancediff.generation.segmented_dance import (
    foot_contact_hooks,
    music_of,
    sampler_options,
    style_of,
)
from dancediff.generation.segmented_request import GCDRequest
from dancediff.generation.segments import SegmentPlan
from dancediff.papers.edge.naive_long_sampling import join
from dancediff.papers.gcd.consistency_guidance import consistency_guided
from dancediff.papers.gcd.long_sampling import MatchedOverlaps, in_one_order


def gcd_dance(model, song, request: GCDRequest, *, report=None, dtype=None) -> Tensor:
    """Sample all segments of a dance as one batch, blending their overlaps in every step.

    One latent serves the whole dance.

    Shapes: -> (n, F, d) metres and 6-D rotations, on the CPU.
    """
    segments = SegmentPlan.of(request, model.config.num_frames)
    k, n, overlap = segments.count, request.dancers, request.overlap
    generator = torch.Generator().manual_seed(request.seed)
    M = segments.music(music_of(model, song))
    z = model.with_draws(Conditions(M[:1]), generator).latent.expand(k, -1)
    conditions = Conditions(M, latent=z, **style_of(model, song, request, segments))
    bind = GuidedDenoiser.of(model, request, dtype).bind
    options, abar = sampler_options(model, request), model.abar.cpu()
    times = sampling_times(options.sampler, options.steps, abar, options.sigma_min)

    def bind_with_gamma(part: Conditions) -> Callable[[Tensor, int], Tensor]:
        return consistency_guided(bind(part), score_of(model, part, n), request.gamma, abar, times)

    x = sample_all(
        in_parts(bind_with_gamma, conditions),
        (k, n, segments.window, model.config.motion_dim),
        options,
        generator=generator,
        hooks=[
            MatchedOverlaps(overlap, model.normalizer.on_cpu()),
            *foot_contact_hooks(model, request),
        ],
        report=report,
    )
    dance = join(model.normalizer.unnormalize(in_one_order(x.cpu(), overlap).to(x)), overlap)
    return dance[:, : request.frames].cpu()


def score_of(model, conditions: Conditions, n: int) -> Callable[[Tensor, int], Tensor]:
    """The critic's score of noisy segments of n dancers, a function of x_t and t."""
    w = model.embedding(conditions, n)

    def score(x_t: Tensor, t: int) -> Tensor:
        steps = torch.full((len(x_t),), t, dtype=torch.long, device=x_t.device)
        return model.critic(x_t, w.clone(), steps)  # made in inference mode, it has no gradient

    return score
