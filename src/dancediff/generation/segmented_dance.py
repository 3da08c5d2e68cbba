r"""What models that dance in segments of 5 s have in common, and the dance of all at once.

Read first: `dancediff.papers.edge.naive_long_sampling`.

Symbols (axes: n dancers · f frames of a segment · F frames of the dance · k segments
         d motion · m music features)
    M        standardised music features                          (F, m), cut: (k, f, m)
    x        the dance, normalised, then in metres                (n, F, d)
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.guidance import ramp_up
from dancediff.diffusion.samplers import SamplerOptions, sampling_times
from dancediff.extensions.constraint import Constraint
from dancediff.extensions.foot_contact_projection import foot_contact_hook
from dancediff.extensions.formation_prior import FormationPrior
from dancediff.extensions.frequency_clip import FrequencyClip, room_for_places
from dancediff.extensions.genre_condition import genres_of
from dancediff.extensions.genre_prior import GenrePrior
from dancediff.extensions.parts import part_of
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.extensions.projection import Projection
from dancediff.extensions.spectrum import Spectrum
from dancediff.generation.all_segments import in_parts, sample_all
from dancediff.generation.energy_option import energy_for
from dancediff.generation.genre_mix import mix_weights
from dancediff.generation.guided_denoiser import GuidedDenoiser
from dancediff.generation.segmented_request import SegmentedRequest
from dancediff.generation.segments import SegmentPlan
from dancediff.generation.tcdiffpp_request import TCDiffPPRequest
from dancediff.motion.representation import TCDIFFPP, cut_to_range
from dancediff.papers.edge.naive_long_sampling import Consistency, join

WIDER = 3  # times as wide a cut for places on the floor, where the caller fixes some


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
    if isinstance(request, TCDiffPPRequest):
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


def style_of(model, song, request: SegmentedRequest, segments: SegmentPlan) -> dict[str, Tensor]:
    """The genre (k, g) and the energy (k, f) that are asked for; without those the model lacks."""
    made = {}
    if request.genre is not None:
        made["genre"] = mix_weights(request.genre, genres_of(model)).expand(segments.count, -1)
    if request.energy is not None:
        energy = energy_for(request.energy, song.features())
        made["energy"] = segments.music(energy[:, None])[..., 0]
    return {name: value.to(model.abar.device) for name, value in made.items()}


def foot_contact_hooks(model, request: SegmentedRequest) -> list[Projection]:
    """The hook that keeps feet in place, where it is asked for."""
    return [foot_contact_hook(model.normalizer.on_cpu())] if request.foot_contact else []


def largest_guess(
    model, request: SegmentedRequest, constraint: Constraint | None = None
) -> Callable[[Tensor], Tensor]:
    """Where guesses are cut: at the training range, but for places, or frequency by frequency.

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
