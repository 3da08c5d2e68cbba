r"""From a song and a resolved request to TCDiff++'s group dance.

Read first: notebook 10 · `dancediff.papers.tcdiffpp.long_group_sampling`.

Symbols (axes: n dancers · f frames of a segment · F frames of the dance · k segments
         d motion · m music features)
    M        standardised music features                          (F, m), cut: (k, f, m)
    x        the dance, normalised, then in metres                (n, F, d)
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.long_sampling import Segment
from dancediff.diffusion.pinning import NOISY_CONTEXT
from dancediff.extensions import control
from dancediff.extensions.collision_avoidance import CollisionAvoidance
from dancediff.extensions.constraint import Constraint, ConstraintHook, Source
from dancediff.extensions.initial_frames import InitialFrames
from dancediff.extensions.order_constraint import OrderConstraint
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.extensions.projection import Projection
from dancediff.generation.guided_denoiser import GuidedDenoiser
from dancediff.generation.segmented_dance import (
    foot_contact_hooks,
    music_of,
    sampler_options,
    style_of,
)
from dancediff.generation.segments import SegmentPlan
from dancediff.generation.tcdiffpp_request import TCDiffPPRequest
from dancediff.motion.motion import Motion
from dancediff.motion.representation import TCDIFFPP
from dancediff.papers.tcdiffpp.long_group_sampling import LongGroupSampler


def tcdiffpp_pieces(
    model, song, request: TCDiffPPRequest, *, report=None, watch=None, dtype=None
) -> Iterator[Tensor]:
    """Finished pieces of a dance, features (n, f, d) in metres, on the CPU."""
    sampler = long_group_sampler(model, song, request, dtype=dtype)

    def callback(done: int, total: int, x0_hat: Tensor) -> None:
        if report is not None:
            report(done, total)
        if watch is not None:
            x = model.normalizer.unnormalize(x0_hat).cpu().clone()  # made in inference mode
            watch(done, total, Motion.from_features(x, fps=FPS))

    for x in replace(sampler, callback=callback).pieces():
        yield model.normalizer.unnormalize(x).cpu()


def long_group_sampler(model, song, request: TCDiffPPRequest, *, dtype=None) -> LongGroupSampler:
    """How a resolved request is danced by TCDiff++."""
    segments = SegmentPlan.of(request, model.config.num_frames)
    music = segments.music(music_of(model, song))
    style, targets = style_of(model, song, request, segments), segments.targets(request)
    return sampler_of(model, request, music, style, targets, dtype=dtype)


def sampler_of(
    model, request: TCDiffPPRequest, music: Tensor, style: dict, targets: Sequence, *, dtype=None
) -> "StyledGroupSampler":
    """A sampler of segments with this music (k, f, m), standardised, and this style and order."""
    constraint = request.constraint()
    assert request.pinning and request.seam  # only naive long sampling has none
    return StyledGroupSampler(
        style=style,
        shape=(request.dancers, model.config.num_frames, model.config.motion_dim),
        bind=GuidedDenoiser.of(model, request, dtype).bind,
        music=music,
        root_x=lambda frame: model.normalizer.unnormalize(frame)[..., TCDIFFPP.lateral],
        targets=targets,
        overlap=request.overlap,
        pinning=request.pinning,
        seam=request.seam,
        resampled=request.resampled,
        hooks=hooks_of(model, request, constraint),
        mask=None if constraint is None else constraint.mask,
        initial_order=None if constraint is None else control.initial_order(constraint),
        options=sampler_options(model, request, constraint),
        generator=torch.Generator().manual_seed(request.seed),
    )


@dataclass(frozen=True, kw_only=True)
class StyledGroupSampler(LongGroupSampler):
    """Long Group Diffusion Sampling with a genre and an energy for each segment.

    ``style``: both by name, of all segments, where the model has parts for them; see `style_of`.
    """

    style: dict[str, Tensor]

    def conditions(self, segment: Segment) -> Conditions:
        """Those of the segment's row."""
        here = slice(segment.number, segment.number + 1)
        style = {name: value[here] for name, value in self.style.items()}
        return replace(super().conditions(segment), **style)


def hooks_of(
    model, request: TCDiffPPRequest, constraint: Constraint | None, *more: Source
) -> list[ConstraintHook | Projection]:
    """What changes guesses while a request is danced by TCDiff++; ``more`` asks for more."""
    normalizer, sources = model.normalizer.on_cpu(), list[Source]()
    if request.pinning in NOISY_CONTEXT and request.seam == "copy":
        sources.append(InitialFrames())
    sources += more
    if constraint is not None:
        fixed = control.normalized(constraint, normalizer)
        sources += [fixed, control.NearbyFrames(fixed)]
    if request.order_constraint:
        sources.append(OrderConstraint(normalizer))
    if request.collision_avoidance:
        sources.append(CollisionAvoidance(normalizer))
    linear, feet = preconditioning_of(model), foot_contact_hooks(model, request)
    if not sources or linear is None:
        return [*feet]
    return [ConstraintHook(linear.std.cpu(), sources), *feet]
