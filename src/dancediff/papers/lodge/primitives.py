r"""Characteristic dance primitives: the few key motions that stand for half a minute of dance.

Read first: Lodge sections 3.2, 3.3 and D.1 · `dancediff.motion.beats`.

Symbols (axes: p primitives · k frames of a primitive · f frames · d = 139 motion features)
    N   frames of a global segment, 1024 = 34 s
    n   frames of a local segment, 256 = 8.5 s (in this package n never counts dancers)
    h   hard primitive: lies across the border of two locals, so that they fit together
    s   soft primitive: a key motion within a local, so that something happens there
    E   kinematic energy around a frame (f,)

In a global segment they come in this order, two soft ones in each local:

    frame  0           n           2n           3n           N
           h0  s   s   h1  s   s   h2   s   s   h3   s   s   h4
"""

import operator
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.motion.beats import kinematic_energy, motion_beats
from dancediff.motion.representation import LODGE, at_origin, joints_of

SOFT_PER_LOCAL = 2


@dataclass(frozen=True)
class Layout:
    """How long segments and primitives are.

    ``stride`` 1 takes neighbouring frames ("continuous"). 4 takes every fourth ("discrete"): as
    many frames, spread over four times as long, which tell poses but hardly any velocity.

    Source: Lodge sections 4.1 (N, n) and D.1.  Differs: D.1 thins the dance four times for its
    discrete primitives and does not say how many are kept; here their number and middle stay.

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
    beats: Iterable[int] | None = None,
    *,
    energy: np.ndarray | None = None,
    joins: Iterable[int] = (),
    layout: Layout = LAYOUT,
) -> tuple[Tensor, Tensor]:
    r"""The primitives of a clip: what global diffusion learns to make.

    $$h_k = x[kn - 4 : kn + 4], \qquad s = x[b - 4 : b + 4]$$

    where b is, in each half of a local, the kinematic beat around which the body moves most. The
    first and the last hard primitive begin and end with the clip. Each primitive's root starts at
    x = z = 0; heights stay.

    - ``beats``: kinematic beats of x where they are known already; default `motion_beats`.
    - ``energy``: of each frame, (N,), where it is known; default `kinematic_energy`.
    - ``joins``: frames at which a clip was put together; no primitive lies across one.

    Source: Lodge sections 1 ("with high kinematic energy") and 3.3 (local minima of velocity).
    Differs: the released code smooths with sigma 5, which merges beats above 120 a minute, takes
    evenly spaced beats without a look at energy, moves the primitives within a clip by up to 2
    frames at random, looks for beats on normalised vectors, cuts h_k at even distances wherever
    the borders are, trains on 25 primitives and dances with 13, and moves the root in views, which
    damages the clip.

    Shapes: x (N, d) metres and 6-D rotations -> primitives (p, 8, d), their frames in x (p, 8).
    Raises: ValueError when x is no clip of N frames.

    >>> primitives, frames = primitives_of(torch.randn(1024, 139))
    >>> primitives.shape, frames[:, 0][::3].tolist()
    (torch.Size([13, 8, 139]), [0, 252, 508, 764, 1016])
    """
    if x.ndim != 2 or len(x) != layout.global_frames:
        raise ValueError(
            f"x has shape {tuple(x.shape)}; expected one clip ({layout.global_frames}, {LODGE.dim})"
        )
    if beats is None or energy is None:
        joints = joints_of(x.detach().cpu().float(), LODGE)  # (N, 24, 3)
        beats = motion_beats(joints) if beats is None else beats
        energy = kinematic_energy(joints) if energy is None else energy
    frames = beside_joins(primitive_frames(beats, layout, energy), joins)
    return at_origin(x[frames.to(x.device)], LODGE), frames


def primitive_frames(
    beats: Iterable[int], layout: Layout = LAYOUT, energy: np.ndarray | None = None
) -> Tensor:
    """Which frames of a clip its primitives take, given its kinematic beats; int (p, 8).

    Soft primitives overlap no other one. Without ``energy`` all beats have the same, and the first
    of each half of a local is taken.

    >>> primitive_frames([70, 200])[1:3].tolist()[0]
    [66, 67, 68, 69, 70, 71, 72, 73]
    """
    N, n, half = layout.global_frames, layout.local_frames, layout.span // 2
    beats, centres = list(beats), [half]
    energy = np.zeros(N) if energy is None else energy
    for border in range(0, N, n):
        centres += fullest(
            beats,
            energy,
            SOFT_PER_LOCAL,
            border,
            border + n,
            margin=layout.span + half,
            apart=layout.span,
        )
        centres.append(min(border + n, N - half))
    return torch.tensor(centres)[:, None] + layout.offsets


def beside_joins(frames: Tensor, joins: Iterable[int]) -> Tensor:
    """Move primitives (p, k) that lie across a join to before it, or behind it near the start.

    >>> beside_joins(torch.tensor([[0, 7], [96, 103], [98, 105]]), [3, 100]).tolist()
    [[3, 10], [92, 99], [92, 99]]
    """
    for join in joins:
        first, last = frames[:, :1], frames[:, -1:]
        to_before, to_behind = join - 1 - last, join - first
        move = torch.where(first + to_before >= 0, to_before, to_behind)
        frames = frames + torch.where((first < join) & (join <= last), move, 0)
    return frames


def thinned_primitives(x: Tensor, layout: Layout = DISCRETE) -> Tensor:
    """Primitives of a dance of which only every fourth frame was made.

    Source: Lodge appendix D.1, which does not say how; here as in training on whole clips.

    Shapes: x (N / 4, d) metres -> (p, 8, d).

    >>> thinned_primitives(torch.randn(256, 139)).shape
    torch.Size([13, 8, 139])
    """
    joints = joints_of(x, LODGE)
    beats = motion_beats(joints) * layout.stride
    energy = kinematic_energy(joints, fps=FPS / layout.stride).repeat(layout.stride)
    return x[primitive_frames(beats, layout, energy) // layout.stride]


def fullest(
    candidates: Iterable[int],
    energy: np.ndarray,
    count: int,
    start: int,
    stop: int,
    *,
    margin: int,
    apart: int,
) -> list[int]:
    """One frame of each of ``count`` parts of start ... stop: the candidate of the highest energy.

    Only those ``margin`` from both ends and ``apart`` from the one before count; a part without any
    gives its middle.

    >>> energy = np.zeros(256)
    >>> energy[80] = 1
    >>> fullest([40, 80, 100, 200], energy, 2, 0, 256, margin=8, apart=8)
    [80, 200]
    >>> fullest([40], energy, 2, 0, 256, margin=8, apart=8)
    [40, 192]
    """
    chosen: list[int] = []
    frames, part = sorted(map(int, candidates)), (stop - start) // count
    for low in range(start, start + count * part, part):
        free = max([start + margin, low, *(frame + apart for frame in chosen)])
        fit = [frame for frame in frames if free <= frame < low + part and frame <= stop - margin]
        chosen.append(max(fit, key=lambda frame: energy[frame]) if fit else low + part // 2)
    return chosen
