r"""What can be asked of every model that dances: one frozen dataclass, every default once.

Read first: notebook 00 · `dancediff.generation.presets`.

    request = TCDiffPPRequest(dancers=3, swap=(2, 1, 0))
    resolved = request.resolve(model, song)     # a new one, in which nothing is left open

Most options are None until `resolve` fills in what the preset says; the others have their default
here. To import this module brings no torch, so that the command line can show its options at once.
"""

from dataclasses import dataclass, fields, replace
from types import NoneType
from typing import Any, ClassVar, Self

from dancediff.generation.option import check_range, checked, kinds_of, option
from dancediff.generation.presets import PRESETS

SEED_STRIDE = 0x9E3779B97F4A7C15  # far apart, so that seeds s and s + 1 share no dancer
SHORTEST_SONG = 1.0  # seconds; less holds no beat
DTYPES = ("float32", "bfloat16", "fastest")


def dtype_name(asked) -> str:
    """What to compute with, by its name; a dtype of torch may be given itself.

    Raises: ValueError for anything but `DTYPES`.

    >>> dtype_name("fastest")
    'fastest'
    """
    name = str(asked).removeprefix("torch.")
    if name not in DTYPES:
        allowed = ", ".join(map(repr, DTYPES))
        raise ValueError(f"dtype={asked!r} is not one of {allowed}")
    return name


@dataclass(frozen=True, kw_only=True)
class DanceRequest:
    """The options that all models share; their types are those of a resolved request.

    Raises: ValueError naming the option, its value and what is allowed.

    >>> DanceRequest(seed=-1)
    Traceback (most recent call last):
    ValueError: seed=-1 must lie in 0 ... 9223372036854775807
    """

    family: ClassVar[str]
    left_out: ClassVar[tuple[str, ...]] = ("device",)  # options that are no facts of a dance

    preset: str = option(
        "packaged",
        "What every option is that is not given: as the packaged models dance best, or as the "
        "papers and their code do.",
        choices=tuple(PRESETS),
    )
    seconds: float = option(None, "How much of the song, from its start; default: all of it.")
    seed: int = option(0, "The same seed gives the same dance.", low=0, high=2**63 - 1)
    dtype: str | None = option(
        None,
        "Compute with all digits, with half of them (bfloat16), or with what is 'fastest'.",
        parse=dtype_name,
    )
    device: str | None = option(None, "Move the model there first, such as 'cuda'.", parse=str)

    def __post_init__(self):
        for one in fields(self):
            value = getattr(self, one.name)
            if value is None and one.default is not None and NoneType not in kinds_of(one):
                raise ValueError(
                    f"{one.name}=None is no value; leave {one.name} out for {one.default!r}"
                )
            if value is not None:
                # one value for equal ones: 1 and 1.0, numpy's 3 and 3
                object.__setattr__(self, one.name, checked(one, value))

    @classmethod
    def names(cls) -> list[str]:
        """Of all options."""
        return [one.name for one in fields(cls)]

    def resolve(self, model, song) -> Self:
        """A new request in which nothing is left open, checked against the model and the song.

        Raises: ValueError naming the option, its value and what is allowed; also for a silent song
        or one under a second.
        """
        seconds = {"seconds": _seconds(self.seconds, song)}
        filled = replace(self, **self.usual(model) | self.asked() | seconds)
        for name, high in self._limits(model.config).items():
            check_range(name, getattr(filled, name), 1, high)
        return filled

    def asked(self) -> dict[str, Any]:
        """The options that were given."""
        given: dict[str, Any] = vars(self)
        return {name: value for name, value in given.items() if value is not None}

    def usual(self, model) -> dict[str, Any]:
        """What the preset says."""
        return dict(PRESETS[self.preset][self.family])

    def _limits(self, config) -> dict[str, int]:
        """The largest value of options for which the model has one."""
        return {}

    @property
    def frames(self) -> int:
        """Length of the dance, of a resolved request."""
        from dancediff.axes import FPS

        return round(self.seconds * FPS)

    def seed_of(self, dancer: int) -> int:
        """The seed of a dancer who dances alone."""
        return (self.seed + dancer * SEED_STRIDE) % 2**63

    def facts(self) -> dict:
        """What a dance says of how it was made: plain values only."""
        return {
            one.name: value
            for one in fields(self)
            if (value := getattr(self, one.name)) is not None and one.name not in self.left_out
        }


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
        raise ValueError(
            f"song {song.name!r} is silent (the mean of its channels peaks at {song.peak:.1e}); "
            "there is no beat"
        )
    seconds = song.duration if seconds is None else seconds
    if seconds > song.duration + 1e-3:
        raise ValueError(f"seconds={seconds:g} is more than the song's {song.duration:.2f}")
    if round(seconds * FPS) < 1:
        raise ValueError(f"seconds={seconds:g} is less than a frame; use at least {1 / FPS:.3f}")
    return seconds
