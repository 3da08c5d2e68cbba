r"""From a song and a resolved request to a group dance.

Read first: notebook 10 · `dancediff.papers.tcdiffpp.long_group_sampling`.

Symbols (axes: n dancers · f frames of a segment · F frames of the dance · k segments
         d motion · m music features)
    M        standardised music features                          (F, m), cut: (k, f, m)
    x        the dance, normalised, then in metres                (n, F, d)
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.guidance import ramp_up
from dancediff.diffusion.long_sampling import Segment
from dancediff.diffusion.pinning import NOISY_CONTEXT
from dancediff.diffusion.samplers import SamplerOptions, sampling_times
from dancediff.extensions import control
from dancediff.extensions.collision_avoidance import CollisionAvoidance
from dancediff.extensions.constraint import Constraint, ConstraintHook, Source
from dancediff.extensions.foot_contact_projection import foot_contact_hook
from dancediff.extensions.formation_prior import FormationPrior
from dancediff.extensions.frequency_clip import FrequencyClip, room_for_places
from dancediff.extensions.genre_condition import genres_of
from dancediff.extensions.genre_prior import GenrePrior
from dancediff.extensions.initial_frames import InitialFrames
from dancediff.extensions.order_constraint import OrderConstraint
from dancediff.extensions.parts import part_of
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.extensions.projection import Projection
from dancediff.extensions.spectrum import Spectrum
from dancediff.generation.all_segments import in_parts, sample_all
from dancediff.generation.energy_request import energy_for
from dancediff.generation.genre_mix import mix_weights
from dancediff.generation.group_request import GroupDanceRequest, SegmentedRequest
from dancediff.generation.guided_denoiser import GuidedDenoiser
from dancediff.generation.segments import SegmentPlan
from dancediff.motion.motion import Motion
from dancediff.motion.representation import TCDIFFPP, cut_to_range
from dancediff.papers.edge.naive_long_sampling import Consistency, join
from dancediff.papers.tcdiffpp.long_group_sampling import LongGroupSampler

WIDER = 3  # times as wide a cut for places on the floor, where the caller fixes some


def group_pieces(
    model, song, request: GroupDanceRequest, *, report=None, watch=None, dtype=None
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


def long_group_sampler(model, song, request: GroupDanceRequest, *, dtype=None) -> LongGroupSampler:
    """How a resolved request is danced by TCDiff++."""
    segments = SegmentPlan.of(request, model.config.num_frames)
    music = segments.music(music_of(model, song))
    style, targets = style_of(model, song, request, segments), segments.targets(request)
    return sampler_of(model, request, music, style, targets, dtype=dtype)


def sampler_of(
    model, request: GroupDanceRequest, music: Tensor, style: dict, targets: Sequence, *, dtype=None
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


def style_of(model, song, request: SegmentedRequest, segments: SegmentPlan) -> dict[str, Tensor]:
    """The genre (k, g) and the energy (k, f) that are asked for; without those the model lacks."""
    made = {}
    if request.genre is not None:
        made["genre"] = mix_weights(request.genre, genres_of(model)).expand(segments.count, -1)
    if request.energy is not None:
        energy = energy_for(request.energy, song.features())
        made["energy"] = segments.music(energy[:, None])[..., 0]
    return {name: value.to(model.abar.device) for name, value in made.items()}


def hooks_of(
    model, request: GroupDanceRequest, constraint: Constraint | None, *more: Source
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


def foot_contact_hooks(model, request: SegmentedRequest) -> list[Projection]:
    """The hook that keeps feet in place, where it is asked for."""
    return [foot_contact_hook(model.normalizer.on_cpu())] if request.foot_contact else []


def naive_dance(
    model, song, request: SegmentedRequest, *, report=None, dtype=None, ramp: bool = False
) -> Tensor:
    """Sample all segments of a dance as one batch and join them, as EDGE does.

    ``ramp``: in long dances guidance rises from 0 over the first half of the steps, as in EDGE's
    code; also to 1, so that the first guesses are made without music. A swap is asked of the
    segment that carries it out; in the others all stay. With TCDiff++ it is the row "w/o LGDS" of
    the paper's ablation.

    Shapes: -> (n, F, d) metres and 6-D rotations, on the CPU.
    """
    segments, device = SegmentPlan.of(request, model.config.num_frames), model.abar.device
    k, n = segments.count, request.dancers
    M = segments.music(music_of(model, song))
    targets: Sequence[Sequence[int] | None] = [None] * k  # EDGE's dancers know of nobody
    if isinstance(request, GroupDanceRequest):
        targets = segments.targets(request) or targets
    S = torch.tensor([range(n) if order is None else order for order in targets], device=device)
    guided = GuidedDenoiser.of(model, request, dtype)
    if ramp and k > 1 and request.sampler != "ddpm":
        times = sampling_times(request.sampler, request.steps, model.abar.cpu(), request.sigma_min)
        guided = replace(guided, guidance=ramp_up(request.guidance, times))
    conditions = Conditions(M, swap=S, **style_of(model, song, request, segments))
    x = sample_all(
        in_parts(guided.bind, conditions),
        (k, n, segments.window, model.config.motion_dim),
        sampler_options(model, request),
        generator=torch.Generator().manual_seed(request.seed),
        pin=Consistency(request.overlap),
        hooks=foot_contact_hooks(model, request),
        report=report,
    )
    return join(model.normalizer.unnormalize(x), request.overlap)[:, : request.frames].cpu()


def largest_guess(
    model, request: SegmentedRequest, constraint: Constraint | None = None
) -> Callable[[Tensor], Tensor]:
    """Where guesses are cut: at the training range, as published, or frequency by frequency.

    ``constraint``: what the caller fixed; if some of it are places, places are cut wider.
    """
    if not request.frequency_clip:
        return cut_to_range
    spectrum = spectrum_asked(model, request)
    std = spectrum.std
    if constraint is not None and constraint.mask[..., TCDIFFPP.floor].any():
        std = std.clone()
        std[:, TCDIFFPP.floor] *= WIDER
    formation, room = part_of(model, FormationPrior), None
    if formation is not None:
        room = room_for_places(formation, request.dancers, len(spectrum.mean))
    return FrequencyClip(spectrum.mean, std, room)


def spectrum_asked(model, request: SegmentedRequest) -> Spectrum:
    """Mean (d,) and spread (k, d) of the training set, or of the genre, if the model knows that."""
    prior = part_of(model, GenrePrior)
    if prior is not None and request.genre is not None:
        w = mix_weights(request.genre, genres_of(model)).to(model.abar.device)
        spectrum = prior(w)
        return Spectrum(spectrum.mean[0], spectrum.std[0])
    preconditioning = preconditioning_of(model)
    assert preconditioning is not None  # `resolve` has looked
    return Spectrum(preconditioning.mean, preconditioning.std)


def sampler_options(
    model, request: SegmentedRequest, constraint: Constraint | None = None
) -> SamplerOptions:
    """How a resolved request is sampled; ``constraint``: see `largest_guess`."""
    return SamplerOptions(
        model.abar,
        request.sampler,
        request.steps,
        request.eta,
        clamp=largest_guess(model, request, constraint),
        sigma_min=request.sigma_min,
    )


def music_of(model, song) -> Tensor:
    """The song's features as the network knows them (F, m)."""
    return standardised(model, song.features())


def standardised(model, M: Tensor) -> Tensor:
    """Features as the network gets them, where it is; (F, m) raw -> (F, m)."""
    return model.music_normalizer.normalize(M.to(model.abar.device))
