"""What can be asked of TCDiff++.

Read first: `dancediff.generation.segmented_request`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Self

from dancediff.generation.diffusion_request import has_preconditioning, sigma_min_option
from dancediff.generation.genre_mix import ANY, BY_TEMPO
from dancediff.generation.option import check_range, one_or_several, option
from dancediff.generation.segmented_request import SegmentedRequest

if TYPE_CHECKING:
    from dancediff.extensions.constraint import Constraint

LOOK_AHEAD = 30  # frames danced again where a constraint may lie just behind a segment's end


@dataclass(frozen=True, kw_only=True)
class TCDiffPPRequest(SegmentedRequest):
    """What can be asked of TCDiff++.

    ``swap[k]``: the dancer, counted 0.. from the left at the first frame (with ``start`` in its
    order), who stands k-th from the left in the end. ``start``, ``end``: one (x, z) in metres a
    dancer. ``constraints``: see `dancediff.extensions.control`. Changes of order are danced most
    often with the sampler "dpm".

    >>> TCDiffPPRequest(dancers=2, pinning="glue")
    Traceback (most recent call last):
    ValueError: pinning='glue' is not one of 'auto', 'same_noise', 'renoise', 'clean', 'init'
    """

    family: ClassVar[str] = "tcdiffpp"

    sigma_min: float = sigma_min_option(None)
    genre_guidance: float = option(
        None,
        "How much a genre that is asked for matters: 1 as learned, more exaggerated (twice the "
        "time).",
        low=1,
        high=10,
    )
    collision_avoidance: bool = option(
        None, "Make room between dancers who would run into each other."
    )
    order_constraint: bool = option(
        None, "Help dancers who were asked to change places to get there."
    )
    swap: Sequence[int] | None = option(
        None, "Order at the end: the dancers (0.. from the left at the start), left to right."
    )
    swap_at: float | None = option(None, "When the swap is done, in seconds; default: at the end.")
    pinning: str | None = option(
        None,
        "How shared frames are kept while a segment is sampled; 'auto': what fits the sampler.",
        choices=("auto", "same_noise", "renoise", "clean", "init"),
    )
    seam: str | None = option(None, "How two segments become one.", choices=("copy", "fade"))
    long_sampling: str = option(
        "lgds",
        "Long Group Diffusion Sampling, or all segments at once as EDGE has it.",
        choices=("lgds", "naive"),
    )
    start: Sequence | None = option(
        None, "A formation at the start: one (x, z) in metres for each dancer."
    )
    end: Sequence | None = option(None, "A formation at the end.")
    constraints: Sequence = option(
        (), "What else must hold: paths, parts of another dance.", parse=one_or_several
    )

    def __post_init__(self):
        super().__post_init__()
        if self.swap is not None:
            from dancediff.motion.order import check_order

            object.__setattr__(self, "swap", check_order(self.swap, self.dancers).tolist())
        elif self.swap_at is not None:
            raise ValueError(f"swap_at={self.swap_at!r} needs swap=, the order to change to")

    def resolve(self, model, song) -> Self:
        """As `DiffusionRequest.resolve`; an order that follows from places at the end is a swap."""
        filled = super().resolve(model, song)._with_genre_guidance(self)
        if filled.swap_at is not None:
            check_range("swap_at", filled.swap_at, 0, filled.seconds)
        naive = filled.long_sampling == "naive"
        filled = filled._naive(self) if naive else filled._with_pinning()
        constraint = filled.constraint()
        return filled if constraint is None else filled._with_constraint(constraint, model)

    def _with_genre_guidance(self, asked: "TCDiffPPRequest") -> Self:
        """As learned, where nobody asked for a genre."""
        filled = self
        if asked.genre in (None, ANY, BY_TEMPO) and asked.genre_guidance is None:
            filled = replace(self, genre_guidance=1.0)
        if filled.genre is None and filled.genre_guidance != 1:
            raise ValueError(
                f"genre_guidance={filled.genre_guidance:g} needs a model that knows genres; use 1"
            )
        return filled

    def _with_pinning(self) -> Self:
        """The pinning that fits the sampler, for "auto"."""
        if self.pinning != "auto":
            return self
        adds_noise = self.sampler == "ddpm" or self.eta > 0
        return replace(self, pinning="renoise" if adds_noise else "same_noise")

    def _with_constraint(self, constraint: "Constraint", model) -> Self:
        """A swap to the order that follows from places at the end.

        Raises: ValueError for what does not go with constraints.
        """
        from dancediff.diffusion.pinning import NOISY_CONTEXT
        from dancediff.extensions import control

        if not has_preconditioning(model):
            raise ValueError(
                "start=, end= and constraints= need statistics of the training data that only a "
                "model with preconditioning has; leave them out"
            )
        if self.pinning not in NOISY_CONTEXT:
            raise ValueError(f"pinning={self.pinning!r} goes with no constraint; use 'same_noise'")
        control.initial_order(constraint)
        order = control.final_order(constraint)
        if order is None or self.swap_at is not None:
            return self
        if self.swap not in (None, order.tolist()):
            raise ValueError(
                f"swap={self.swap} asks for another order than the places at the end, "
                f"{order.tolist()}; leave one out"
            )
        return replace(self, swap=order.tolist(), swap_at=self.seconds)

    def _naive(self, asked: "TCDiffPPRequest") -> Self:
        """Without what belongs to Long Group Diffusion Sampling."""
        for name in ("collision_avoidance", "order_constraint"):
            if getattr(asked, name):
                raise ValueError(
                    f"{name}=True is not possible with long_sampling='naive'; use False"
                )
        for name in ("pinning", "seam"):
            if (value := getattr(asked, name)) is not None:
                raise ValueError(
                    f"{name}={value!r} is not possible with long_sampling='naive'; leave it out"
                )
        if self.constraint() is not None:
            raise ValueError("start=, end= and constraints= need long_sampling='lgds'")
        return replace(
            self, collision_avoidance=False, order_constraint=False, pinning=None, seam=None
        )

    @property
    def resampled(self) -> int:
        """Frames that a segment dances again instead of keeping them, for constraints behind."""
        free = not self.constraints and self.start is None and self.end is None
        return 0 if free else min(LOOK_AHEAD, self.overlap // 2)

    def constraint(self) -> "Constraint | None":
        """All constraints of a resolved request as one, in metres and matrices."""
        from dancediff.axes import FPS
        from dancediff.extensions import control

        controls = list(self.constraints)
        if self.start is not None:
            controls.append(control.StartAt(self.start))
        if self.end is not None:
            controls.append(control.EndAt(self.end))
        return control.combine(controls, self.dancers, self.frames, FPS) if controls else None
