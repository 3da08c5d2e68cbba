r"""The request for a dance: one frozen dataclass a family of models, every default once.

Read first: notebook 00 · `dancediff.generation.presets`.

    request = GroupDanceRequest(dancers=3, swap=(2, 1, 0))
    resolved = request.resolve(model, song)     # a new one, in which nothing is left open

Most options are None until `resolve` fills in what the preset says; the others have their default
here. An option's ``metadata`` says what it does and which values it may have: the command line,
panels and the generated page read it there. To import this module brings no torch, so that the
command line can show its options at once.
"""

import math
import operator
from collections.abc import Sequence
from dataclasses import Field, dataclass, field, fields, replace
from types import UnionType
from typing import TYPE_CHECKING, Any, ClassVar, get_args

from dancediff.extensions.registry import REGISTRY
from dancediff.generation.presets import PAPER, PRESETS
from dancediff.genre import genre_for, genre_number

if TYPE_CHECKING:
    import torch

    from dancediff.extensions.constraint import Constraint

LOOK_AHEAD = 30  # frames danced again where a constraint may lie just behind a segment's end
SHORTEST_SONG = 1.0  # seconds; less holds no beat
RENAMED = {  # old name: (new name, what the old values are now)
    "feet": ("foot_contact", {"planted": True, "free": False}),
    "spacing": ("collision_avoidance", {"kept": True, "free": False}),
    "order": ("order_constraint", {"kept": True, "free": False}),
    "home": ("return_to_origin", {}),
    "long": ("long_sampling", {}),
}


def option(default, help: str, *, choices: tuple = (), low=0, high=math.inf) -> Any:
    """A field of a request with its help and the values that it may have."""
    limits = {"help": help, "choices": tuple(choices), "low": low, "high": high}
    return field(default=default, metadata=limits)


@dataclass(frozen=True, kw_only=True)
class SamplingConfig:
    """The options that all models share.

    Raises: ValueError naming the option, its value and what is allowed.

    >>> GroupDanceRequest(eta=2)
    Traceback (most recent call last):
    ValueError: eta=2 must lie in 0 ... 1
    """

    family: ClassVar[str]

    preset: str = option(
        "packaged",
        "What every option is that is not given: as the packaged models dance best, or as the "
        "papers say.",
        choices=tuple(PRESETS),
    )
    seconds: float | None = option(
        None, "How much of the song, from its start; default: all of it."
    )
    seed: int = option(0, "The same seed gives the same dance.", low=0, high=2**63 - 1)
    sampler: str | None = option(
        None,
        "How noise is taken away: DPM-Solver++, DDIM, or DDPM in all steps.",
        choices=("dpm", "ddim", "ddpm"),
    )
    steps: int | None = option(None, "Denoising steps.", low=1, high=1000)
    eta: float | None = option(
        None, "Fresh noise in a step of DDIM: 0 none, 1 as much as DDPM.", low=0, high=1
    )
    guidance: float | None = option(
        None,
        "How much the music matters: 0 not at all, 1 as learned, 2 exaggerated (twice the time).",
        low=0,
        high=100,
    )
    autoguidance: float | None = option(
        None,
        "1 takes guesses as they are, more pushes them away from the mean of all dances.",
        low=1,
        high=10,
    )
    foot_contact: bool | None = option(
        None, "Keep feet in place that stand; False leaves them as the network draws them."
    )
    dtype: "torch.dtype | str | None" = option(  # noqa: RUF009 - it is a field
        None, "Compute with all digits, with half of them (bfloat16), or with what is 'fastest'."
    )
    device: "torch.device | str | None" = option(  # noqa: RUF009 - it is a field
        None, "Move the model there first, such as 'cuda'."
    )

    def __post_init__(self):
        for one in fields(self):
            if (value := getattr(self, one.name)) is not None:
                # one value for equal ones: 1 and 1.0, numpy's 3 and 3
                object.__setattr__(self, one.name, checked(one, value))

    @classmethod
    def of(cls, name: str, options: dict) -> "SamplingConfig":
        """The request with these options, asked of the model ``name``.

        Raises: ValueError for an option that has another name now, belongs to another family of
        models, or is none; and as the request itself.

        >>> LodgeRequest.of("lodge", {"home": False})
        Traceback (most recent call last):
        ValueError: home=False is now return_to_origin=False
        >>> GroupDanceRequest.of("trio", {"genre": "salsa"})
        Traceback (most recent call last):
        ValueError: genre='salsa' is not for the model 'trio'; models of lodge have it
        """
        for key, value in options.items():
            if key in cls.names():
                continue
            if key in RENAMED:
                new, values = RENAMED[key]
                value_now = values.get(value, value) if isinstance(value, str) else value
                raise ValueError(f"{key}={value!r} is now {new}={value_now!r}")
            others = [other.family for other in REQUESTS.values() if key in other.names()]
            if others:
                raise ValueError(
                    f"{key}={value!r} is not for the model {name!r}; "
                    f"models of {' and '.join(others)} have it"
                )
            raise ValueError(f"{key}={value!r} is no option; choose from {', '.join(cls.names())}")
        return cls(**options)

    @classmethod
    def names(cls) -> list[str]:
        """Of all options."""
        return [one.name for one in fields(cls)]

    def resolve(self, model, song) -> "SamplingConfig":
        """A new request in which nothing is left open, checked against the model and the song.

        Raises: ValueError naming the option, its value and what is allowed; also for a silent song
        or one under a second.
        """
        seconds = _seconds(self.seconds, song)
        asked = {name: value for name, value in vars(self).items() if value is not None}
        usual = dict(PRESETS[self.preset][self.family])
        if not has_preconditioning(model):
            for name, off in needs_preconditioning(self.family).items():
                if asked.get(name, off) != off:
                    raise ValueError(
                        f"{name}={asked[name]!r} needs statistics of the training data that only "
                        f"a model with preconditioning has; use {off!r}"
                    )
                usual[name] = off
        filled = replace(self, **usual | asked | {"seconds": seconds})
        for name, high in self._limits(model.config).items():
            _in_range(name, getattr(filled, name), 1, high)
        return filled

    def _limits(self, config) -> dict[str, int]:
        """The largest value of options for which the model has one."""
        return {"steps": config.num_steps}

    @property
    def frames(self) -> int:
        """Length of the dance, of a resolved request."""
        from dancediff.axes import FPS

        return round(self.seconds * FPS)

    def facts(self) -> dict:
        """What a dance says of how it was made: plain values only."""
        return {
            one.name: value if one.name != "dtype" else str(value).removeprefix("torch.")
            for one in fields(self)
            if (value := getattr(self, one.name)) is not None
            and one.name not in ("device", "at_once", "start", "end", "constraints")
        }


@dataclass(frozen=True, kw_only=True)
class SegmentedRequest(SamplingConfig):
    """What can be asked of models that dance in segments of 5 s."""

    dancers: int = option(3, "How many people dance.", low=1)
    overlap: int = option(75, "Frames that segments of 5 s share.", low=1)
    frequency_clip: bool | None = option(
        None, "Cut guesses at what each frequency of the training set reaches, not at its range."
    )

    def _limits(self, config) -> dict[str, int]:
        own = {"dancers": config.max_dancers, "overlap": config.num_frames - 1}
        return super()._limits(config) | own


@dataclass(frozen=True, kw_only=True)
class EDGERequest(SegmentedRequest):
    """What can be asked of EDGE: each dancer alone, then placed side by side."""

    family: ClassVar[str] = "edge"


@dataclass(frozen=True, kw_only=True)
class GroupDanceRequest(SegmentedRequest):
    """What can be asked of TCDiff++.

    ``swap[k]``: the dancer, counted 0.. from the left at the first frame, who stands k-th from the
    left in the end. ``start``, ``end``: one (x, z) in metres a dancer. ``constraints``: see
    `dancediff.extensions.control`. Changes of order need the sampler "dpm".

    >>> GroupDanceRequest(dancers=2, pinning="glue")
    Traceback (most recent call last):
    ValueError: pinning='glue' is not one of 'auto', 'same_noise', 'renoise', 'clean', 'init'
    """

    family: ClassVar[str] = "tcdiffpp"

    collision_avoidance: bool | None = option(
        None, "Make room between dancers who would run into each other."
    )
    order_constraint: bool | None = option(
        None, "Help dancers who were asked to change places to get there."
    )
    swap: Sequence[int] | None = option(
        None, "Order at the end: the dancers (0.. from the left at the start), left to right."
    )
    swap_at: float | None = option(None, "When the swap is done, in seconds; default: at the end.")
    pinning: str | None = option(
        None,
        "How a segment is held at the end of the one before; 'auto' is what fits the sampler.",
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
    constraints: Sequence = option((), "What else must hold: paths, parts of another dance.")

    def __post_init__(self):
        super().__post_init__()
        if self.swap is not None:
            from dancediff.motion.order import check_order

            object.__setattr__(self, "swap", check_order(self.swap, self.dancers).tolist())
        elif self.swap_at is not None:
            raise ValueError(f"swap_at={self.swap_at!r} needs swap=, the order to change to")

    def resolve(self, model, song) -> "GroupDanceRequest":
        """As `SamplingConfig.resolve`; an order that follows from places at the end is a swap."""
        from dancediff.diffusion.pinning import HOLDING
        from dancediff.extensions import control

        filled = super().resolve(model, song)
        if filled.swap_at is not None:
            _in_range("swap_at", filled.swap_at, 0, filled.seconds)
        if filled.long_sampling == "naive":
            filled = filled._naive(self)
        elif filled.pinning == "auto":
            adds_noise = filled.sampler == "ddpm" or filled.eta > 0
            filled = replace(filled, pinning="renoise" if adds_noise else "same_noise")
        known = filled.known()
        if known is None:
            return filled
        if not has_preconditioning(model):
            raise ValueError(
                "start=, end= and constraints= need statistics of the training data that only a "
                "model with preconditioning has; leave them out"
            )
        if filled.pinning not in HOLDING:
            raise ValueError(
                f"pinning={filled.pinning!r} goes with no constraint; use 'same_noise'"
            )
        control.initial_order(known)
        order = control.final_order(known)
        if order is None or filled.swap_at is not None:
            return filled
        if filled.swap not in (None, order.tolist()):
            raise ValueError(
                f"swap={filled.swap} asks for another order than the places at the end, "
                f"{order.tolist()}; leave one out"
            )
        return replace(filled, swap=order.tolist(), swap_at=filled.seconds)

    def _naive(self, asked: "GroupDanceRequest") -> "GroupDanceRequest":
        """Without what belongs to Long Group Diffusion Sampling."""
        for name in ("collision_avoidance", "order_constraint"):
            if getattr(asked, name):
                raise ValueError(
                    f"{name}=True is not possible with long_sampling='naive'; use False"
                )
        return replace(
            self, collision_avoidance=False, order_constraint=False, pinning=None, seam=None
        )

    @property
    def resampled(self) -> int:
        """Frames that a segment dances again instead of keeping them, for constraints behind."""
        controls = (*self.constraints, self.start, self.end)
        none = all(one is None for one in controls)
        return 0 if none else min(LOOK_AHEAD, self.overlap // 2)

    def known(self) -> "Constraint | None":
        """All constraints of a resolved request as one, in metres and matrices."""
        from dancediff.axes import FPS
        from dancediff.extensions import control

        controls = list(self.constraints)
        controls += [control.StartAt(self.start)] * (self.start is not None)
        controls += [control.EndAt(self.end)] * (self.end is not None)
        return control.combine(controls, self.dancers, self.frames, FPS) if controls else None


@dataclass(frozen=True, kw_only=True)
class LodgeRequest(SamplingConfig):
    """What can be asked of Lodge: a solo, also danced by a group."""

    family: ClassVar[str] = "lodge"

    dancers: int = option(1, "How many people dance, all the same solo.", low=1, high=5)
    genre: str | None = option(None, "What to dance; default: by the song's tempo.")
    soft: float = option(
        1.0, "For which share of the steps the dance is held at its soft cues.", low=0, high=1
    )
    mirror: bool = option(True, "Dance each soft cue a second time, mirrored.")
    beat_align: bool = option(True, "Put soft cues on beats.")
    repeat_sections: bool | None = option(
        None, "A section of the song that comes again gets the soft cues of its first time."
    )
    smooth_primitives: bool | None = option(
        None, "Keep pose, velocity and acceleration of a primitive, not its unrest."
    )
    cue_constraint: bool | None = option(
        None, "Condition guesses on hard cues, so that these are met without a jump."
    )
    border_smoothing: bool | None = option(
        None, "Bend the frames beside hard cues so that these are met without a jerk."
    )
    root_stitching: bool | None = option(
        None, "Go on over seams from where the segment before ended; else back to the middle."
    )
    return_to_origin: bool | None = option(
        None, "Come back to the same place every 8.5 s; without it a dancer may walk off."
    )
    formation: str = option("line", "Where the dancers of a group begin, such as 'line' or 'V'.")
    relation: str = option(
        "unison",
        "All the same, each four beats later than the one to the left, or mirrored.",
        choices=("unison", "canon", "mirror"),
    )
    at_once: int | None = option(
        16, "Segments in memory together (16 are two minutes), None: all; the dance is the same.",
        low=1,
    )  # fmt: skip

    def resolve(self, model, song) -> "LodgeRequest":
        """As `SamplingConfig.resolve`; the genre, if none is asked for, is that of the tempo."""
        from dancediff.extensions.group_relations import places

        filled = super().resolve(model, song)
        genres = model.config.genres
        if filled.genre is not None:
            genre_number(filled.genre, genres)
        places(filled.dancers, filled.formation)
        return replace(filled, genre=filled.genre or genre_for(song.tempo, genres))

    def facts(self) -> dict:
        """As `SamplingConfig.facts`; a solo has no formation."""
        of_groups = ("formation", "relation") if self.dancers == 1 else ()
        return {name: value for name, value in super().facts().items() if name not in of_groups}


REQUESTS = {one.family: one for one in (GroupDanceRequest, LodgeRequest, EDGERequest)}


def has_preconditioning(model) -> bool:
    """Does the model know the statistics of its training data?"""
    from dancediff.extensions.preconditioning import preconditioning_of

    return preconditioning_of(model) is not None


def needs_preconditioning(family: str) -> dict:
    """Options that need the statistics of preconditioning, and what they are without them.

    >>> needs_preconditioning("edge")
    {'autoguidance': 1.0, 'frequency_clip': False}
    """
    return {
        name: off
        for name, off in PAPER[family].items()
        if name in REGISTRY and "preconditioning" in REGISTRY[name].needs
    }


def default_of(family: str, name: str, preset: str = "packaged"):
    """What an option is where nobody says otherwise; None: it follows from model and song.

    >>> default_of("tcdiffpp", "steps"), default_of("tcdiffpp", "steps", "paper")
    (12, 50)
    >>> default_of("lodge", "soft")
    1.0
    """
    own = REQUESTS[family].__dataclass_fields__[name].default
    return PRESETS[preset][family].get(name, own)


def kinds_of(one: Field) -> tuple:
    """The types that an option may have."""
    return get_args(one.type) if isinstance(one.type, UnionType) else (one.type,)


def checked(one: Field, value):
    """A value of an option as its type, if it is among those allowed.

    Raises: ValueError naming the option, its value and what is allowed.
    """
    if choices := one.metadata["choices"]:
        if value not in choices:
            allowed = ", ".join(map(repr, choices))
            raise ValueError(f"{one.name}={value!r} is not one of {allowed}")
        return value
    kinds = kinds_of(one)
    if bool in kinds:
        if str(value) not in ("True", "False"):
            raise ValueError(f"{one.name}={value!r} must be True or False")
        return bool(value)
    low, high = one.metadata["low"], one.metadata["high"]
    if int in kinds:
        try:
            value = operator.index(value)
        except TypeError:
            raise ValueError(f"{one.name}={value!r} must be an integer") from None
        _in_range(one.name, value, low, high)
    elif float in kinds:
        try:
            value = float(value)
        except (TypeError, ValueError):
            raise ValueError(f"{one.name}={value!r} must be a number") from None
        _in_range(one.name, value, low, high)
    return value


def _in_range(name: str, value: float, low: float, high: float) -> None:
    if not (low <= value <= high and math.isfinite(value)):
        limit = f"lie in {_short(low)} ... {_short(high)}"
        if high == math.inf:
            limit = f"be a number of at least {_short(low)}"
        raise ValueError(f"{name}={_short(value)} must {limit}")


def _short(value: float) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _seconds(seconds: float | None, song) -> float:
    """How long the dance is.

    Raises: ValueError when the song is too short for it, or silent.
    """
    from dancediff.axes import FPS

    if song.duration < SHORTEST_SONG:
        raise ValueError(
            f"song is {song.duration:.2f} s long; at least {SHORTEST_SONG:g} s are needed"
        )
    if song.is_silent:
        raise ValueError(f"song {song.name!r} is silent (peak {song.peak:.1e}); there is no beat")
    seconds = song.duration if seconds is None else seconds
    if seconds > song.duration + 1e-3:
        raise ValueError(f"seconds={seconds:g} is more than the song's {song.duration:.2f}")
    if round(seconds * FPS) < 1:
        raise ValueError(f"seconds={seconds:g} is less than a frame; use at least {1 / FPS:.3f}")
    return seconds
