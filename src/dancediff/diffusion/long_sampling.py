r"""Long sampling: a dance of any length from a network that knows a window of it.

Read first: notebook 10 · `dancediff.diffusion.pinning`.

Symbols (axes: n dancers · f frames of a segment · F of the dance · k of context · d features)
    x         the dance, normalised; row i is dancer i for good               (n, F, d)
    order     order[r] = the dancer in row r of what the network is given     (n,)
    context   frames that the segment before has danced, in the order of rows (n, k, d)
    overlap   frames that a segment shares with the one before it             75 of 150 in TCDiff++
    x_T       noise that a segment is made from, in the order of rows         (n, f, d)

A segment begins with the end of the one before: those frames are pinned, the rest is sampled.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import torch
from torch import Tensor

from dancediff.diffusion.pinning import MODES, Pinning
from dancediff.diffusion.samplers import GuessHook, SamplerOptions, sample
from dancediff.diffusion.schedule import gaussian


@dataclass(frozen=True)
class Segment:
    """One window of a long dance before it is sampled; all but ``target`` is in rows.

    >>> Segment(0, 0, (3, 8, 2), order=torch.tensor([2, 0, 1]), mask=torch.zeros(3, 8, 2)).row
    tensor([1, 2, 0])
    """

    number: int
    start: int  # its first frame in the dance
    shape: tuple[int, int, int]  # (n, f, d)
    order: Tensor
    mask: Tensor  # entries that are given: the context, and what the caller fixed (n, f, d)
    context: Tensor | None = None
    target: Tensor | None = None  # the dancers in the order asked for at its end, None: in any

    @property
    def row(self) -> Tensor:
        """The row of each dancer (n,), the inverse of ``order``."""
        return self.order.argsort()


class SegmentHook(Protocol):
    """Makes the hook on the guesses of one segment."""

    def for_segment(self, segment: Segment) -> GuessHook | None:
        """The hook for this segment; None where it has nothing to do."""
        ...


def keep_context(context: Tensor, x: Tensor) -> Tensor:
    """Join two segments: keep the context exactly; what was sampled there is dropped.

    Shapes: context (n, k, d), x (n, f, d) -> (n, f, d).

    >>> keep_context(torch.zeros(1, 2, 1), torch.ones(1, 4, 1)).flatten().tolist()
    [0.0, 0.0, 1.0, 1.0]
    """
    return torch.cat([context, x[:, context.shape[1] :]], dim=1)


def fade_context(context: Tensor, x: Tensor) -> Tensor:
    r"""Join two segments: cross-fade from the context to what was sampled there.

    $$x_f \leftarrow (1 - w_f)\,\text{context}_f + w_f\,x_f, \quad w_f = f / (k - 1)$$

    Source: TCDiff++ "merge"; EDGE's code.  Differs: rotations are blended in 6-D, and become
    rotations again when they are unpacked; the official code takes the arc between them. The
    two stay within degrees of each other where the paths do; 120 degrees apart, 23 degrees.

    Shapes: context (n, k, d), x (n, f, d) -> (n, f, d).

    >>> fade_context(torch.zeros(1, 3, 1), torch.ones(1, 4, 1)).flatten().tolist()
    [0.0, 0.5, 1.0, 1.0]
    """
    k = context.shape[1]
    w = torch.linspace(0, 1, k, dtype=x.dtype, device=x.device)[:, None]
    return torch.cat([torch.lerp(context, x[:, :k], w), x[:, k:]], dim=1)


SEAMS = {"copy": keep_context, "fade": fade_context}


@dataclass(frozen=True, kw_only=True)
class LongSampler(ABC):
    r"""Sample a dance segment after segment; memory stays that of a segment.

    - ``shape``: (n, f, d) of a segment.
    - ``options``, ``generator``: of `sample`, the same for every segment; one generator, no list.
    - ``pinning``: how the context is kept, see `Pinning`. With "init" the shared frames also get
      the noise that they were made from.
    - ``seam``: how the context is joined to what follows, a key of `SEAMS`.
    - ``resampled``: so many shared frames are sampled again instead of kept, so that a constraint
      just behind a segment's end is not seen too late.
    - ``hooks`` change every guess; each one is made anew for every segment.
    - ``mask``: entries of the dance that the caller fixed (n, F, d), for hooks to keep.
    - ``targets``: for each segment the dancers in the order asked for at its end, or None: that of
      the segment before.
    - ``initial_order``: the dancers by rank at the first frame, if the caller has numbered them;
      else they are numbered by rank.
    - ``callback(done, total, x0_hat)`` counts the denoising steps of the whole dance; x0_hat is the
      guess of that step, (n, f, d).

    A subclass says in `denoiser` what the network is given, in `num_segments` how often, and may
    `rank` the dancers.

    Raises: ValueError for an overlap outside 1 ... f - 1, an unknown pinning or seam.
    """

    shape: tuple[int, int, int]
    options: SamplerOptions
    overlap: int
    pinning: str
    seam: str
    generator: torch.Generator | None = None
    resampled: int = 0
    hooks: Sequence[SegmentHook] = ()
    mask: Tensor | None = None
    targets: Sequence[Sequence[int] | Tensor | None] = ()
    initial_order: Tensor | None = None
    callback: Callable[[int, int, Tensor], None] | None = field(default=None, repr=False)

    def __post_init__(self):
        f = self.shape[1]
        if not 1 <= self.overlap < f:
            raise ValueError(f"overlap={self.overlap} must lie in 1 ... {f - 1}, of {f} frames")
        if not 0 <= self.resampled < self.overlap:
            raise ValueError(
                f"resampled={self.resampled} must lie in 0 ... {self.overlap - 1}, so that some of "
                "the shared frames are kept"
            )
        for name, allowed in (("pinning", MODES), ("seam", SEAMS)):
            if getattr(self, name) not in allowed:
                words = ", ".join(map(repr, allowed))
                raise ValueError(f"{name}={getattr(self, name)!r} is not one of {words}")

    def rank(self, frame: Tensor) -> Tensor:
        """The dancers in the order in which the network expects them in a frame (n, d)."""
        return torch.arange(len(frame))

    @abstractmethod
    def denoiser(self, segment: Segment) -> Callable[[Tensor, int], Tensor]:
        """``denoise(x_t (1, n, f, d), t) -> x0_hat`` for a segment."""

    @property
    def stride(self) -> int:
        """Frames that every segment adds."""
        return self.shape[1] - self.overlap

    @property
    @abstractmethod
    def num_segments(self) -> int:
        """How many segments the dance has."""

    def dance(self) -> Tensor:
        """The whole dance, normalised (n, f + (k - 1)(f - overlap), d)."""
        return torch.cat(list(self.pieces()), dim=1)

    def pieces(self) -> Iterator[Tensor]:
        """Its frames (n, F', d), as soon as they are final."""
        context = noise = None
        for number in range(self.num_segments):
            x, noise = self.danced(self.plan(number, context), context, noise)
            rest = x[:, self.stride :]
            context = rest[:, : self.overlap - self.resampled]
            yield x[:, : self.stride]
        yield rest

    def danced(
        self, segment: Segment, context: Tensor | None, before: Tensor | None
    ) -> tuple[Tensor, Tensor]:
        """A segment joined to its context, and its noise; both (n, f, d) by dancer.

        ``context``: that of the plan, by dancer; ``before``: the noise of the segment before.
        """
        x_T = self.first_input(segment, before)
        x = self.sampled(segment, x_T)
        dancers = self.by_dancer(segment, x)
        x = x[dancers]
        if context is not None:
            x = SEAMS[self.seam](context, x)
        return x, x_T[dancers]

    def plan(self, number: int, context: Tensor | None, start: int | None = None) -> Segment:
        """A segment that goes on from ``context``, which is by dancer.

        ``start``: its first frame in the dance, if segments do not follow each other.
        """
        n, f, _ = self.shape
        start, k = number * self.stride if start is None else start, 0
        order = torch.arange(n) if self.initial_order is None else self.initial_order
        if context is not None:
            order = self.rank(context[:, 0]).cpu()
            context, k = context[order], context.shape[1]
        mask = torch.zeros(self.shape, dtype=torch.bool)
        if self.mask is not None:
            here = self.mask[order, start : start + f]
            mask[:, : here.shape[1]] = here
        mask[:, :k] = True
        asked = [target for target in self.targets[: number + 1] if target is not None]
        target = torch.as_tensor(asked[-1]) if asked else None
        return Segment(number, start, self.shape, order, mask, context, target)

    def first_input(self, segment: Segment, before: Tensor | None) -> Tensor:
        """Fresh noise; with pinning "init" the context keeps that of the segment before."""
        x_T = gaussian(self.shape, generator=self.generator)
        if self.pinning == "init" and segment.context is not None and before is not None:
            k = segment.context.shape[1]
            x_T[:, :k] = before[segment.order, self.stride : self.stride + k]
        return x_T

    def sampled(self, segment: Segment, x_T: Tensor) -> Tensor:
        """Sample a segment from x_T, its context pinned; (n, f, d) in rows."""
        pin, hooks = None, [hook.for_segment(segment) for hook in self.hooks]
        if segment.context is not None:
            abar, generator = self.options.abar.cpu(), self.generator
            pin = Pinning(segment.context[None], abar, mode=self.pinning, generator=generator)

        def after_step(i: int, steps: int, x0_hat: Tensor) -> None:
            if self.callback is not None:
                done = segment.number * steps + i + 1
                self.callback(done, self.num_segments * steps, x0_hat[0])

        return sample(
            self.denoiser(segment),
            (1, *self.shape),
            self.options,
            generator=self.generator,
            x_T=x_T[None],
            pin=pin,
            hooks=[hook for hook in hooks if hook is not None],
            callback=after_step,
        )[0]

    def by_dancer(self, segment: Segment, x: Tensor) -> Tensor:
        """The row of each dancer; the first segment numbers them by rank, if nobody else has."""
        if segment.context is None and self.initial_order is None and self.mask is None:
            return self.rank(x[:, 0]).cpu()
        return segment.row
