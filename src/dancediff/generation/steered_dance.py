r"""A group dance whose request may change from one segment to the next.

Read first: `dancediff.diffusion.long_sampling` · `dancediff.generation.tcdiffpp_dance`.

Symbols (axes: n dancers · f frames of a segment · F of the song · d motion · m music features)
    context  the frames that the next segment goes on from, by dancer   (n, k, d)
    M        music features of the song, raw                             (F, m)
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.diffusion.long_sampling import Segment
from dancediff.diffusion.pinning import NOISY_CONTEXT
from dancediff.extensions import control
from dancediff.extensions.constraint import Constraint, Source
from dancediff.extensions.genre_condition import genres_of
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.generation.energy_option import energy_for
from dancediff.generation.genre_mix import mix_weights
from dancediff.generation.opening import Opening
from dancediff.generation.segmented_dance import sampler_options, standardised
from dancediff.generation.segments import SegmentPlan
from dancediff.generation.tcdiffpp_dance import StyledGroupSampler, hooks_of, sampler_of
from dancediff.generation.tcdiffpp_request import TCDiffPPRequest
from dancediff.music.live_song import LiveSong

JOIN = 15  # frames of the dance so far that a dance goes on from elsewhere in the song


@dataclass(frozen=True)
class AtEnd:
    """A source for `ConstraintHook`: what holds in the last frame of a segment."""

    source: Source  # of a segment, not of the dance

    def for_segment(self, segment: Segment) -> Source | None:
        """In the segment's rows."""
        return self.source.for_segment(replace(segment, start=0))

    def at(self, guess: Tensor, abar: float) -> None:
        """As a `Source`: nothing before the segment is known."""


class SteeredDance:
    """Dances segment after segment; what is asked for is looked up before each of them.

    Without a change it is the dance of `tcdiffpp_pieces`, to the last bit.
    """

    def __init__(self, model, song, request: TCDiffPPRequest):
        """``request`` is resolved; ``song`` is a `Music`, an `Opening` or a `LiveSong`."""
        self.model, self.song, self.request = model, song, request
        self.over = False  # the song's end was reached
        self._formation: Constraint | None = None
        self._placed: Constraint | None = None  # the last one: who is far out walks back later
        self._order: Sequence[int] | None = None  # asked for since the dance began
        self._ordered = False  # an order was asked for, or given up, since then
        self._start = self._skip = 0  # of the next segment: first frame in the song, frames danced
        self._count = 0  # segments begun
        self.seams: list[int] = []  # frames of what is handed out in which a segment takes over
        self._handed = 0  # frames handed out
        self._generator = torch.Generator().manual_seed(request.seed)
        self._context: Tensor | None = None
        self._noise: Tensor | None = None
        self._last: Tensor | None = None  # frames that were handed out
        self._music: tuple[Tensor, Tensor] | None = None

    @property
    def _stride(self) -> int:
        return self.model.config.num_frames - self.request.overlap

    def ask(self, request: TCDiffPPRequest, *, ordered: bool = False) -> None:
        """What the next segments are asked for; ``ordered``: ``request.swap`` is new."""
        if request.dancers < self.request.dancers:
            self._leave(request.dancers)
        self.request = request
        if ordered:
            self._order, self._ordered, self._formation = request.swap, True, None

    def _leave(self, stay: int) -> None:
        """All but the first ``stay`` dancers leave; the others go on from where they are."""
        self._formation = None
        if self._order is not None:
            self._order = [dancer for dancer in self._order if dancer < stay]
        for name in ("_context", "_noise", "_last"):
            x = getattr(self, name)
            setattr(self, name, None if x is None else x[:stay])

    def form(self, places: Sequence | None) -> None:
        """Where everybody stands at the end of the next segments; None: anywhere.

        Raises: ValueError for places that do not fit the dancers, or a model that cannot do it.
        """
        self._formation = None if places is None else self.formation(places, self._shape[0])
        self._placed = self._formation or self._placed
        self._ordered, self._order = True, None
        if places is not None:
            order = control.final_order(control.EndAt(places).constraint(*self._shape, FPS))
            assert order is not None  # it is known of all dancers
            self._order = order.tolist()

    @property
    def _shape(self) -> tuple[int, int]:
        return self.request.dancers, self.model.config.num_frames

    @property
    def can_form(self) -> bool:
        """Whether the model can be told where to stand."""
        preconditioned = preconditioning_of(self.model) is not None
        return preconditioned and self.request.pinning in NOISY_CONTEXT

    def formation(self, places: Sequence, dancers: int) -> Constraint:
        """Places of so many at a segment's end, in the network's units; raises as `form`."""
        if not self.can_form:
            raise ValueError(
                "formation= needs a model with preconditioning, and pinning='same_noise'; leave "
                "it out"
            )
        constraint = control.EndAt(places).constraint(dancers, self._shape[1], FPS)
        return control.normalized(constraint, self.model.normalizer.on_cpu())

    def seek(self, frame: int) -> None:
        """Go on at another frame of the song, from where the dancers are.

        The last frames that were handed out are the context, so nobody jumps.
        """
        k = 0 if self._last is None else min(self._last.shape[1], self._stride - 1)
        self._context = None if self._last is None or k == 0 else self._last[:, -k:]
        self._noise, self._skip, self._start, self.over = None, k, frame - k, False
        self.seams = [seam for seam in self.seams if seam < self._handed]  # others never come

    def pieces(
        self, changes: Callable[[], None], *, eager: bool = False, report=None, dtype=None
    ) -> Iterator[tuple[int, Tensor]]:
        """Its first frame in the song and a piece, features (n, f, d) in metres, on the CPU.

        ``eager``: frames that the next segment shall share are handed out, too, and not with that
        segment; so a piece is there 2.5 s earlier. It needs ``seam`` "copy", which keeps them.
        ``changes``: called before every segment; it may call the methods above. It goes on after
        the song's end if it is called again after `seek`.
        """
        while True:
            changes()
            if self.over:
                return
            x, noise = self._segment(report, dtype)
            start, stride, skip = self._start, self._stride, self._skip
            if self._context is not None:
                self.seams.append(self._handed + self._context.shape[1] - skip)
            frames, rest = self.request.frames, x[:, stride:]
            last = start + x.shape[1] >= frames
            self._context, self._noise = rest[:, : self._kept], noise
            self._start, self._skip = start + stride, self._kept if eager else 0
            end = x.shape[1] if eager else stride
            parts = [(start + skip, x[:, skip:end]), (start + end, x[:, end:])][: 1 + last]
            parts = [(at, part[:, : max(frames - at, 0)]) for at, part in parts]
            parts = [(at, part) for at, part in parts if part.shape[1]]
            for k, (at, part) in enumerate(parts):
                self.over = last and k == len(parts) - 1
                yield at, self._handed_out(part)

    @property
    def _kept(self) -> int:
        return self.request.overlap - self.request.resampled

    def _handed_out(self, x: Tensor) -> Tensor:
        """A piece in metres; its last frames are kept for `seek`."""
        both = x if self._last is None else torch.cat([self._last, x], dim=1)
        self._last, self._handed = both[:, -JOIN:].clone(), self._handed + x.shape[1]
        return self.model.normalizer.unnormalize(x).cpu()

    def _segment(self, report, dtype) -> tuple[Tensor, Tensor]:
        """The next segment and its noise, both (n, f, d) by dancer."""
        sampler = self._sampler(dtype)
        if report is not None:
            done, total = self._count, SegmentPlan.of(self.request, sampler.shape[1]).count

            def callback(i: int, steps: int, x0_hat: Tensor) -> None:
                report(done * steps + i, max(total, done + 1) * steps)

            sampler = replace(sampler, callback=callback)
        self._count += 1
        segment = sampler.plan(0, self._context, self._start)
        if self._formation is not None:
            mask = segment.mask | self._formation.mask  # all dancers, so rows do not matter
            segment = replace(segment, mask=mask)
        return sampler.danced(segment, self._context, self._noise)

    def _sampler(self, dtype) -> StyledGroupSampler:
        """A sampler of one segment."""
        model, request = self.model, self.request
        M, music = self._features()
        style = {}
        if request.genre is not None:
            style["genre"] = mix_weights(request.genre, genres_of(model))
        if request.energy is not None:
            style["energy"] = self._window(energy_for(request.energy, M))
        style = {name: value.to(model.abar.device) for name, value in style.items()}
        sampler = sampler_of(
            model, request, self._window(music), style, self._targets(), dtype=dtype
        )
        if self._formation is not None:
            near = control.NearbyFrames(self._formation, self._stride // 3)  # two thirds to walk in
            sources = AtEnd(self._formation), AtEnd(near)
            sampler = replace(sampler, hooks=hooks_of(model, request, None, *sources))
        if self._placed is not None:
            sampler = replace(sampler, options=sampler_options(model, request, self._placed))
        return replace(sampler, generator=self._generator)

    def _features(self) -> tuple[Tensor, Tensor]:
        """The song's features, raw and standardised; as much as the next segment needs to know."""
        M = self.song
        if not isinstance(M, Opening | LiveSong) or self._start < 0:
            M = M.features()
        else:
            M = M.features_until(self._start + self.model.config.num_frames)
        if self._music is None or self._music[0] is not M:
            self._music = M, standardised(self.model, M)
        return self._music

    def _window(self, x: Tensor) -> Tensor:
        """The segment's part of something along the song, which goes round; (F, …) -> (1, f, …).

        It lies in memory as that of `SegmentPlan.music`, so that no sum is rounded otherwise.
        """
        start = self._start % len(x)
        stop = start + self.model.config.num_frames
        times = -(-stop // len(x))
        x = x.repeat(times, *[1] * (x.ndim - 1)) if times > 1 else x
        return x[None, start:stop]

    def _targets(self) -> Sequence[Sequence[int] | None]:
        """The order at the segment's end: the last one that was asked for, None without one."""
        if self._ordered:
            return [self._order]
        plan = SegmentPlan.of(self.request, self.model.config.num_frames)
        number = max(0, math.ceil(self._start / plan.stride))
        asked = [one for one in plan.targets(self.request)[: number + 1] if one is not None]
        return asked[-1:]
