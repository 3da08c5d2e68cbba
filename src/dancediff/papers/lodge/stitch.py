r"""From a song to segments, and from segments to one dance.

Read first: Lodge section 3.2 and "Parallel Inference".

Symbols (axes: f frames of a segment · F frames of the dance · d motion, m music features)
    N, n   frames of a global and of a local segment, 1024 and 256
    G, L   how many of them a song has
    v      velocity of the root, metres a frame

A song of 2100 frames (the last local goes beyond its end and is cut off; the last global is moved
back so that it ends with the last local):

    locals    |0    |256  |512  |768  |1024 |1280 |1536 |1792 |2048 |
    globals   |0                      |1024                   |
                                            |1280                   |
"""

import operator
from dataclasses import dataclass, field

import torch
from torch import Tensor

from dancediff.motion.representation import LODGE, MotionSpec
from dancediff.papers.lodge.primitives import LAYOUT, Layout


@dataclass(frozen=True)
class Plan:
    """First frames of all global and local segments of a dance of ``frames`` frames."""

    frames: int
    globals: tuple[int, ...]
    locals: tuple[int, ...]
    layout: Layout = field(default=LAYOUT, repr=False)

    @property
    def seams(self) -> list[int]:
        """Frames of the dance in which a local takes over from the one before."""
        return list(self.locals[1:])

    @property
    def shared(self) -> list[int]:
        """How many locals of each global were already in the global before it."""
        n, done, shared = self.layout.local_frames, 0, []
        for start in self.globals:
            shared.append(done - start // n)
            done = start // n + self.layout.locals_per_global
        return shared

    def global_music(self, M: Tensor, part: slice = slice(None)) -> Tensor:
        """Music of some globals, (F, m) -> (G, N, m); behind its end the song starts again."""
        return self._cut(M, self.globals[part], self.layout.global_frames)

    def local_music(self, M: Tensor, part: slice = slice(None)) -> Tensor:
        """Music of some locals, (F, m) -> (L, n, m); behind its end the song starts again."""
        return self._cut(M, self.locals[part], self.layout.local_frames)

    def _cut(self, M: Tensor, starts: tuple[int, ...], length: int) -> Tensor:
        if len(M) < self.frames:
            raise ValueError(f"M has {len(M)} frames, the dance {self.frames}; plan a shorter one")
        rows = torch.tensor(starts)[:, None] + torch.arange(length)
        return M[rows.to(M.device) % len(M)]


def plan(frames: int, layout: Layout = LAYOUT) -> Plan:
    r"""Cut a dance of any length into segments.

    $$L = \lceil F / n \rceil, \qquad G = \lceil L\,n / N \rceil$$

    Globals follow one another; the last one ends with the last local, and so may lie over some of
    the global before. A song shorter than N has one global, with the song over again at its end.

    Source: Lodge's code.  Differs: it drops what is left after the last whole local, and refuses
    songs shorter than N.

    Raises: ValueError for less than 1 frame.

    >>> plan(2100).globals, len(plan(2100).locals), plan(300).locals
    ((0, 1024, 1280), 9, (0, 256))
    """
    frames = operator.index(frames)
    if frames < 1:
        raise ValueError(f"frames={frames} is no length; a dance has at least 1 frame")
    N, n = layout.global_frames, layout.local_frames
    L = -(-frames // n)
    last = max(0, L * n - N)
    starts = [min(start, last) for start in range(0, L * n, N)]
    return Plan(frames, tuple(starts), tuple(range(0, L * n, n)), layout)


def stitch(x: Tensor, *, blend: int = 8, spec: MotionSpec = LODGE) -> Tensor:
    r"""Put locals one after another so that the root goes on without a jump.

    On the floor each local continues where the one before ended, with the mean of both velocities
    in between, and within ``blend`` frames on both sides the velocities approach that mean v':

    $$v' = \tfrac12 (v^{-} + v^{+}), \qquad v_i \leftarrow v_i + w_i\,(v' - v^{\mp}), \qquad
      w_i = \tfrac12 (1 + \cos(\pi i / B)), \quad i = 1 \dots B - 1$$

    A height cannot be continued like this without drifting off the floor; the gap e that is left
    in it is closed over the same frames instead, $y_i \pm w_i\,e / 2$. Everything else is taken as
    it is: contacts and rotations meet because both sides hold half of one hard primitive.

    Source: ours; the paper says "coherent", the released code only concatenates, and its dancers
    jump back to the middle every 256 frames. That a dance does not walk off the stage is the
    sampler's affair (``home`` of `dancediff.papers.lodge.cue_guidance.CueGuidance`): moving a
    finished path
    would make planted feet slide.

    Shapes: x (L, n, d) metres and 6-D rotations -> (L n, d).  Units of velocities: metres a frame.
    Raises: ValueError for a blend outside 0 ... n / 2.

    >>> x = torch.zeros(2, 32, 139)
    >>> x[..., 4] = torch.arange(32.0)                    # both walk a metre a frame from 0
    >>> stitch(x)[:, 4].equal(torch.arange(64.0))
    True
    """
    n = x.shape[1]
    if not 0 <= blend <= n // 2:
        raise ValueError(f"blend={blend} must lie in 0 ... {n // 2}, half a local")
    if n < 2:
        raise ValueError(f"x has shape {tuple(x.shape)}; a local of one frame has no velocity")
    y = x.flatten(0, 1).clone()
    root = x[..., spec.root].double()
    for axis in (0, 2):
        y[:, spec.root.start + axis] = _path(root[..., axis], blend).to(y)
    y[:, spec.root.start + 1] = _height(root[..., 1], blend).to(y)
    return y


def _path(p: Tensor, blend: int) -> Tensor:
    """One coordinate on the floor: (L, n) -> (L n,), by adding up mended velocities."""
    n, v = p.shape[1], torch.zeros_like(p)
    v[:, 1:] = p.diff(dim=1)
    before, after = v[:-1, -1].clone(), v[1:, 1].clone()
    v[1:, 0] = (before + after) / 2
    w = _fade(blend).to(p)[1:]  # the seam itself is done
    k = min(len(w), n - 1)
    v[1:, 1 : k + 1] -= (after - before)[:, None] / 2 * w[:k]
    v[:-1, n - k :] += (after - before)[:, None] / 2 * w[:k].flip(0)
    return p[0, 0] + v.flatten().cumsum(0)


def _height(p: Tensor, blend: int) -> Tensor:
    """Heights: (L, n) -> (L n,), the gap at each seam closed from both sides."""
    step = (p[:-1, -1] - p[:-1, -2] + p[1:, 1] - p[1:, 0]) / 2
    gap = (p[1:, 0] - p[:-1, -1] - step)[:, None] / 2
    y, w = p.clone(), _fade(blend).to(p)
    y[1:, : len(w)] -= gap * w
    y[:-1, p.shape[1] - len(w) :] += gap * w.flip(0)
    return y.flatten()


def _fade(blend: int) -> Tensor:
    """From 1 at a seam to nearly 0 ``blend`` frames away, (blend,)."""
    return (1 + torch.cos(torch.pi * torch.arange(blend, dtype=torch.float64) / blend)) / 2
