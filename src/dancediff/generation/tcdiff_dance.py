"""From a song and a resolved request to a dance of TCDiff.

Read first: `dancediff.papers.tcdiff.model` · `dancediff.generation.segmented_dance`.

Symbols (axes: n dancers · f frames of a segment · F frames of the dance · k segments · d motion)
    path    where everybody goes, normalised x and z, by dancer       (k, n, f, 2)
    order   order[i, r] = the dancer of rank r in segment i           (k, n)
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.samplers import GuessHook
from dancediff.extensions.foot_contact_projection import foot_contact_hook
from dancediff.generation.all_segments import in_parts, sample_all
from dancediff.generation.guided_denoiser import GuidedDenoiser
from dancediff.generation.segmented_dance import music_of, sampler_options, style_of
from dancediff.generation.segmented_request import TCDiffRequest
from dancediff.generation.segments import SegmentPlan
from dancediff.motion.order import left_to_right
from dancediff.motion.representation import TCDIFFPP
from dancediff.papers.edge.naive_long_sampling import Consistency, join
from dancediff.papers.tcdiff.trajectory_diffusion import on_path


@dataclass(frozen=True)
class OnPath:
    """A hook on guesses: everybody stands on the path. Rules after it leave the root there."""

    path: Tensor

    def apply(self, x0_hat: Tensor, abar: float) -> Tensor:
        """Shapes: x0_hat (k, n, f, d) -> the same."""
        return on_path(x0_hat, self.path)


def tcdiff_dance(model, song, request: TCDiffRequest, *, report=None, dtype=None) -> Tensor:
    """Make the paths of the whole dance, then all segments of bodies as one batch.

    The network was trained on dancers ranked from left to right, so each segment is handed over in
    the order in which its paths begin.

    Shapes: -> (n, F, d) metres and 6-D rotations, on the CPU.
    """
    segments = SegmentPlan.of(request, model.config.num_frames)
    k, n, overlap = segments.count, request.dancers, request.overlap
    generator = torch.Generator().manual_seed(request.seed)
    M = music_of(model, song)
    paths = model.paths(segments.whole(M)[None], n, generator)[0]
    path = paths.unfold(1, segments.window, segments.stride).permute(1, 0, 3, 2)
    order = left_to_right(path[:, :, 0, 0])
    style = style_of(model, song, request, segments)
    conditions = Conditions(segments.music(M), path=reordered(path, order), **style)
    by_rank = in_parts(GuidedDenoiser.of(model, request, dtype).bind, conditions)

    def denoise(x_t: Tensor, t: int) -> Tensor:
        return reordered(by_rank(reordered(x_t, order), t), order.argsort(1))

    shape = (k, n, segments.window, model.config.motion_dim)
    hooks: list[GuessHook] = [OnPath(path.cpu())]
    if request.foot_contact:
        fixed = torch.zeros(shape, dtype=torch.bool)
        fixed[..., TCDIFFPP.floor] = True
        hooks.append(foot_contact_hook(model.normalizer.on_cpu(), fixed))
    x = sample_all(
        denoise,
        shape,
        sampler_options(model, request),
        generator=generator,
        pin=Consistency(overlap),
        hooks=hooks,
        report=report,
    )
    return join(model.normalizer.unnormalize(x), overlap)[:, : request.frames].cpu()


def reordered(x: Tensor, order: Tensor) -> Tensor:
    """The dancers of each segment in another order.

    Shapes: x (k, n, f, d), order (k, n) -> like x.

    >>> x = torch.tensor([[[[0.0]], [[1.0]]], [[[2.0]], [[3.0]]]])
    >>> reordered(x, torch.tensor([[0, 1], [1, 0]])).flatten().tolist()
    [0.0, 1.0, 3.0, 2.0]
    """
    return x.gather(1, order[:, :, None, None].expand_as(x))
