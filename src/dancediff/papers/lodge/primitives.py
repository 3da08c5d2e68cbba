r"""Characteristic dance primitives: the few key motions that stand for half a minute of dance.

Read first: Lodge sections 3.2, 3.3 and D.1 · `dancediff.motion.beats`.

Symbols (axes: p primitives · k frames of a primitive · f frames · d = 139 motion features)
    N   frames of a global segment, 1024 = 34 s
    n   frames of a local segment, 256 = 8.5 s (in this package n never counts dancers)
    h   hard primitive: lies across the border of two locals, so that they fit together
    r   soft primitive: a key motion within a local, so that something happens there

In a global segment they come in this order, two soft ones in each local:

    frame  0           n           2n           3n           N
           h0  r   r   h1  r   r   h2   r   r   h3   r   r   h4
"""

import operator
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from dancediff.motion.beats import motion_beats
from dancediff.motion.representation import LODGE, MotionSpec, joints_of
from dancediff.motion.rotation import matrix_to_rot6d, rot6d_to_matrix

SOFT_PER_LOCAL = 2
SIGMA = 5.0  # frames; smooths the joints' mean speed before its minima are taken
MAX_SHIFT = 2  # frames by which the soft primitives of a training clip are moved, all alike


@dataclass(frozen=True)
class Layout:
    """How long segments and primitives are.

    ``stride`` 1 takes neighbouring frames ("continuous"). 4 takes every fourth ("discrete"): as
    many frames, spread over four times as long, which tell poses but hardly any velocity.

    Source: Lodge sections 4.1 (N, n) and D.1.  Differs: D.1 thins the dance four times for its
    discrete primitives and does not say how many are kept; ours keep their number and their middle.

    Raises: ValueError when locals do not fill a global, or are too short for their cues.

    >>> Layout().num_primitives, Layout().num_frames, Layout(stride=4).span
    (13, 104, 32)
    """

    global_frames: int = 1024
    local_frames: int = 256
    length: int = 8
    stride: int = 1

    def __post_init__(self):
        for name in ("global_frames", "local_frames", "length", "stride"):
            value = operator.index(getattr(self, name))
            if value < 1:
                raise ValueError(f"{name}={value} must be at least 1")
            object.__setattr__(self, name, value)
        if self.length % 2:
            raise ValueError(f"length={self.length} must be even: a hard primitive is cut in half")
        if self.global_frames % self.local_frames:
            raise ValueError(
                f"global_frames={self.global_frames} is no multiple of "
                f"local_frames={self.local_frames}; choose e.g. 1024 and 256"
            )
        if self.local_frames < 8 * self.span:
            raise ValueError(
                f"local_frames={self.local_frames} is too short for cues of {self.span} frames; "
                f"choose at least {8 * self.span}"
            )

    @property
    def locals_per_global(self) -> int:
        """N / n."""
        return self.global_frames // self.local_frames

    @property
    def num_primitives(self) -> int:
        """Hard and soft ones of a global segment: 5 + 8 = 13."""
        return (1 + SOFT_PER_LOCAL) * self.locals_per_global + 1

    @property
    def num_frames(self) -> int:
        """Frames that global diffusion makes: 13 x 8 = 104."""
        return self.num_primitives * self.length

    @property
    def span(self) -> int:
        """Frames of the dance that a primitive lies over."""
        return self.length * self.stride

    @property
    def offsets(self) -> Tensor:
        """Frames of a primitive, counted from its middle: -4 ... 3."""
        return (torch.arange(self.length) - self.length // 2) * self.stride


LAYOUT = Layout()
DISCRETE = Layout(stride=4)


def primitives_of(
    x: Tensor,
    generator: torch.Generator | None = None,
    *,
    layout: Layout = LAYOUT,
    sigma: float = SIGMA,
    max_shift: int = MAX_SHIFT,
    spec: MotionSpec = LODGE,
) -> tuple[Tensor, Tensor]:
    r"""The primitives of a training clip: what global diffusion learns to make.

    $$h_k = x[kn - 4 : kn + 4], \qquad r = x[b - 4 + \delta : b + 4 + \delta]$$

    where b are kinematic beats, two in each local, and $\delta$ is drawn once for the clip from
    -2 ... 2 (not without a generator). The first and the last hard primitive begin and end with the
    clip. Each primitive's root starts at x = z = 0; heights stay.

    Source: Lodge section 3.3.  Differs: the released code looks for beats on normalised vectors,
    cuts h_k at multiples of 128 k / 4 wherever the borders are, trains on 25 primitives and dances
    with 13, and moves the root in views, which damages the clip they were cut from.

    Shapes: x (N, d) metres and 6-D rotations -> primitives (p, 8, d), their frames in x (p, 8).
    Raises: ValueError when x is no clip of N frames.

    >>> primitives, frames = primitives_of(torch.randn(1024, 139))
    >>> primitives.shape, frames[:, 0][::3].tolist()
    (torch.Size([13, 8, 139]), [0, 252, 508, 764, 1016])
    """
    if x.ndim != 2 or len(x) != layout.global_frames:
        raise ValueError(
            f"x has shape {tuple(x.shape)}; expected one clip ({layout.global_frames}, {spec.dim})"
        )
    shift = 0
    if generator is not None and max_shift:
        shift = int(torch.randint(-max_shift, max_shift + 1, (), generator=generator))
    beats = motion_beats(joints_of(x.detach().cpu().float(), spec), sigma=sigma)
    frames = primitive_frames(beats, layout, shift=shift, max_shift=max_shift)
    return at_origin(x[frames.to(x.device)], spec), frames


def primitive_frames(
    beats: Iterable[int], layout: Layout = LAYOUT, *, shift: int = 0, max_shift: int = MAX_SHIFT
) -> Tensor:
    """Which frames of a clip its primitives take, given its kinematic beats; int (p, 8).

    Soft primitives overlap no other one, whatever the shift.

    >>> primitive_frames([70, 200])[1:3].tolist()[0]
    [66, 67, 68, 69, 70, 71, 72, 73]
    """
    N, n, half = layout.global_frames, layout.local_frames, layout.span // 2
    beats, centres = list(beats), [half]
    for border in range(0, N, n):
        soft = spread_evenly(
            beats,
            SOFT_PER_LOCAL,
            border,
            border + n,
            margin=layout.span + half + max_shift,
            apart=layout.span,
        )
        centres += [b + shift for b in soft] + [min(border + n, N - half)]
    return torch.tensor(centres)[:, None] + layout.offsets


def spread_evenly(
    candidates: Iterable[int], count: int, start: int, stop: int, *, margin: int, apart: int
) -> list[int]:
    """``count`` frames of start ... stop: candidates as far as there are, else in the largest gaps.

    Kept are those ``margin`` from both ends and ``apart`` from each other. Of too many every so
    manieth is taken; too few are completed by halving the largest gap; without any the frames are
    spread evenly.

    >>> spread_evenly([40, 80, 120, 160, 200], 2, 0, 256, margin=8, apart=8)
    [80, 160]
    >>> spread_evenly([40], 2, 0, 256, margin=8, apart=8)
    [40, 148]
    >>> spread_evenly([], 2, 0, 256, margin=8, apart=8)
    [64, 192]
    """
    chosen: list[int] = []
    for frame in sorted(map(int, candidates)):
        far = not chosen or frame - chosen[-1] >= apart
        if far and start + margin <= frame <= stop - margin:
            chosen.append(frame)
    if not chosen:
        return [start + (2 * i + 1) * (stop - start) // (2 * count) for i in range(count)]
    if len(chosen) > count:
        return [chosen[(2 * i + 1) * len(chosen) // (2 * count)] for i in range(count)]
    while len(chosen) < count:
        fences = [start, *chosen, stop]
        gaps = [after - before for before, after in pairwise(fences)]
        k = gaps.index(max(gaps))
        chosen.insert(k, (fences[k] + fences[k + 1]) // 2)
    return chosen


def expressive(joints: Tensor, *, sigma: float = SIGMA, length: int = 8) -> Tensor:
    r"""Which frames are key motions, the rest being transitions between them.

    $$\{\,i : b - 4 \le i < b + 4 \text{ for a kinematic beat } b\,\}$$

    Source: Lodge section 3.3, which calls motion near the minima of velocity expressive.

    Shapes: joints (f, 24, 3) metres -> bool (f,).

    >>> path = torch.cos(torch.arange(60) / 60 * 4 * torch.pi)      # turns round every 15 frames
    >>> expressive(path[:, None, None] * torch.ones(60, 24, 3), sigma=1).sum().item()
    24
    """
    mask = torch.zeros(len(joints), dtype=torch.bool)
    for b in motion_beats(joints.detach().cpu(), sigma=sigma).tolist():
        mask[max(0, b - length // 2) : b + length // 2] = True
    return mask


def smooth_primitives(x: Tensor, spec: MotionSpec = LODGE) -> Tensor:
    r"""The parabola through the rotations of each primitive, by least squares; the rest stays.

    $$x_k \leftarrow a + b\,\tau_k + c\,\tau_k^2$$

    A primitive tells a pose, a velocity and whether that changes. What eight frames of a network
    say beyond it is unrest, and local diffusion would have to repeat it at every seam.

    Source: ours.

    Shapes: x (..., 8, d) -> (..., 8, d), rotations orthonormal again.

    >>> x = torch.randn(3, 8, 139)
    >>> twice = smooth_primitives(smooth_primitives(x))
    >>> twice.shape, torch.equal(twice[..., :7], x[..., :7])
    (torch.Size([3, 8, 139]), True)
    """
    tau = torch.linspace(-1, 1, x.shape[-2], dtype=torch.float64)
    powers = torch.stack([tau**0, tau, tau**2], dim=-1)
    fit = (powers @ torch.linalg.pinv(powers)).to(x)
    smooth = fit @ x[..., spec.rot6d]
    y = x.clone()
    y[..., spec.rot6d] = matrix_to_rot6d(rot6d_to_matrix(smooth.unflatten(-1, (-1, 6)))).flatten(-2)
    return y


def at_origin(x: Tensor, spec: MotionSpec = LODGE) -> Tensor:
    """Move each clip so that its root starts at x = z = 0; a copy, heights unchanged.

    Shapes: x (..., f, d) metres -> (..., f, d).

    >>> x = torch.ones(2, 5, 139)
    >>> at_origin(x)[1, :, 4:7].unique(dim=0).tolist(), x.min().item()
    ([[0.0, 1.0, 0.0]], 1.0)
    """
    y = x.clone()
    y[..., spec.root] -= x[..., :1, spec.root] * x.new_tensor([1.0, 0.0, 1.0])
    return y
