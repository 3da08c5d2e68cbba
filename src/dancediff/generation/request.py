r"""The arguments of `generate`, checked, and what follows from them alone.

Symbols (axes: n dancers · F frames of the dance)
    swap     swap[k] = the dancer, counted from the left at the start, who ends k-th       (n,)
    known    what the caller fixed, in metres and matrices, see `control`                (n, F, d)
    numbers  dancers from left to right at the start, where the caller has numbered them (n,)
"""

import math
import operator
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from dancediff.diffusion.pinning import MODES
from dancediff.diffusion.samplers import SAMPLERS
from dancediff.extensions import control
from dancediff.extensions.collision_avoidance import SPACING
from dancediff.extensions.foot_contact_projection import FEET
from dancediff.extensions.order_constraint import ORDER
from dancediff.papers.tcdiffpp.long_group_sampling import HOLDING, SEAMS
from dancediff.papers.tcdiffpp.swap_mode import check_order

FPS = 30
SHORTEST_SONG = 1.0  # seconds; less holds no beat


@dataclass
class Wish:
    """The arguments of `generate`, checked.

    Raises: ValueError naming the argument, its value and what is allowed.

    >>> Wish(max_dancers=5, song_seconds=30.0, dancers=9)
    Traceback (most recent call last):
    ValueError: dancers=9 must lie in 1 ... 5
    """

    max_dancers: int
    song_seconds: float
    num_frames: int = 150
    num_steps: int = 1000
    dancers: int = 3
    seconds: float | None = None
    seed: int = 0
    steps: int = 12
    sampler: str = "dpm"
    guidance: float = 1.0
    autoguidance: float | None = None  # AUTOGUIDANCE if the model can
    eta: float = 0.0
    swap: Any = None
    swap_at: float | None = None
    overlap: int = 75
    pinning: str | None = None  # the way of pinning that fits the sampler
    seam: str = "copy"
    feet: str = "planted"
    spacing: str | None = None  # kept if the model can
    order: str | None = None  # kept if the model can
    start: Any = None
    end: Any = None
    constraints: Any = ()
    in_last = False  # is the order at the end asked for by places in the last frame?

    def __post_init__(self):
        self._check_length()
        self.dancers = _integer("dancers", self.dancers, 1, self.max_dancers)
        self.seed = _integer("seed", self.seed, 0, 2**63 - 1)
        self.steps = _integer("steps", self.steps, 1, self.num_steps)
        self.overlap = _integer("overlap", self.overlap, 1, self.num_frames - 1)
        self.guidance = _number("guidance", self.guidance, 0, 100)
        if self.autoguidance is not None:
            self.autoguidance = _number("autoguidance", self.autoguidance, 1, 10)
        self.eta = _number("eta", self.eta, 0, 1)
        one_of("sampler", self.sampler, SAMPLERS)
        one_of("pinning", self.pinning, (None, *MODES))
        if self.pinning is None:
            adds_noise = self.sampler == "ddpm" or self.eta > 0
            self.pinning = "renoise" if adds_noise else "same_noise"
        one_of("seam", self.seam, tuple(SEAMS))
        one_of("feet", self.feet, FEET)
        one_of("spacing", self.spacing, (None, *SPACING))
        one_of("order", self.order, (None, *ORDER))
        if self.swap is not None:
            self.swap = check_order(self.swap, self.dancers)
        elif self.swap_at is not None:
            raise ValueError(f"swap_at={self.swap_at!r} needs swap=, the order to change to")
        if self.swap_at is not None:
            self.swap_at = _number("swap_at", self.swap_at, 0, self.seconds)
        self._combine_constraints()

    def _combine_constraints(self) -> None:
        """What is known of the dance, in metres; the order at its end is a swap, too."""
        asked = list(self.constraints)
        asked += [control.StartAt(self.start)] * (self.start is not None)
        asked += [control.EndAt(self.end)] * (self.end is not None)
        self.known = control.combine(asked, self.dancers, self.frames, FPS)
        self.numbers = None
        if self.known is None:
            return
        if self.pinning not in HOLDING:
            raise ValueError(f"pinning={self.pinning!r} goes with no constraint; use 'same_noise'")
        self.numbers = control.numbers_at_start(self.known)
        order = control.order_at_end(self.known)
        if order is not None and self.swap_at is None:
            if self.swap is not None and self.swap.tolist() != order.tolist():
                raise ValueError(
                    f"swap={self.swap.tolist()} asks for another order than the places at the "
                    f"end, {order.tolist()}; leave one out"
                )
            self.swap, self.in_last = order, True

    def _check_length(self) -> None:
        if self.song_seconds < SHORTEST_SONG:
            raise ValueError(
                f"song is {self.song_seconds:.2f} s long; at least {SHORTEST_SONG:g} s are needed"
            )
        if self.seconds is None:
            self.seconds = self.song_seconds
        seconds = _number("seconds", self.seconds, 0, math.inf)
        if seconds > self.song_seconds + 1e-3:
            raise ValueError(f"seconds={seconds:g} is more than the song's {self.song_seconds:.2f}")
        if round(seconds * FPS) < 1:
            raise ValueError(
                f"seconds={seconds:g} is less than a frame; use at least {1 / FPS:.3f}"
            )
        self.seconds = seconds

    @property
    def frames(self) -> int:
        """Length of the dance in frames."""
        return round(self.seconds * FPS)

    @property
    def stride(self) -> int:
        """Frames that every segment adds."""
        return self.num_frames - self.overlap

    @property
    def segments(self) -> int:
        """How many windows the dance needs; the last may reach beyond its end."""
        return 1 + max(0, math.ceil((self.frames - self.num_frames) / self.stride))

    def target_orders(self) -> list[Tensor | None] | None:
        """Which segment carries out the swap, as `long_group_sample` wants to know it.

        It is the first one that ends at ``swap_at`` or later; by default the last one that ends
        within the dance, so that the whole swap is seen.

        >>> Wish(5, 60.0, seconds=20, dancers=2, swap=[1, 0]).target_orders()
        [None, None, None, None, None, None, tensor([1, 0])]
        >>> Wish(5, 60.0, seconds=10, dancers=2, swap=[1, 0], swap_at=6).target_orders()
        [None, tensor([1, 0]), None]
        """
        if self.swap is None:
            return None
        if self.in_last:
            chosen = self.segments - 1
        elif self.swap_at is None:
            chosen = (self.frames - self.num_frames) // self.stride
        else:
            chosen = math.ceil((self.swap_at * FPS - self.num_frames) / self.stride)
        orders: list[Tensor | None] = [None] * self.segments
        orders[min(max(chosen, 0), self.segments - 1)] = self.swap
        return orders


def _integer(name: str, value, low: int, high: int) -> int:
    try:
        number = operator.index(value)
    except TypeError:
        raise ValueError(f"{name}={value!r} must be an integer in {low} ... {high}") from None
    if not low <= number <= high:
        raise ValueError(f"{name}={number} must lie in {low} ... {high}")
    return number


def _number(name: str, value, low: float, high: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name}={value!r} must be a number in {low:g} ... {high:g}") from None
    if not (low <= number <= high and math.isfinite(number)):
        raise ValueError(f"{name}={number:g} must lie in {low:g} ... {high:g}")
    return number


def one_of(name: str, value, allowed: tuple) -> None:
    """Refuse a value that is not among those allowed."""
    if value not in allowed:
        raise ValueError(f"{name}={value!r} is not one of {', '.join(map(repr, allowed))}")
