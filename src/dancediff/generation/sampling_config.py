r"""What can be asked of every model: one frozen dataclass, every default once.

Read first: notebook 00 · `dancediff.generation.presets`.

    request = GroupDanceRequest(dancers=3, swap=(2, 1, 0))
    resolved = request.resolve(model, song)     # a new one, in which nothing is left open

Most options are None until `resolve` fills in what the preset says; the others have their default
here. To import this module brings no torch, so that the command line can show its options at once.
"""

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

from dancediff.extensions.registry import REGISTRY
from dancediff.generation.energy_request import energy_of, is_curve, resolved_energy
from dancediff.generation.genre_mix import BY_TEMPO, mix_of, resolved_genre
from dancediff.generation.option import checked, in_range, option
from dancediff.generation.presets import PAPER, PRESETS

if TYPE_CHECKING:
    import torch

SHORTEST_SONG = 1.0  # seconds; less holds no beat


@dataclass(frozen=True, kw_only=True)
class SamplingConfig:
    """The options that all models share; their types are those of a resolved request.

    Raises: ValueError naming the option, its value and what is allowed.

    >>> SamplingConfig(eta=2)
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
    seconds: float = option(None, "How much of the song, from its start; default: all of it.")
    seed: int = option(0, "The same seed gives the same dance.", low=0, high=2**63 - 1)
    sampler: str = option(
        None,
        "How noise is taken away: DPM-Solver++, DDIM, DDPM in all steps, or module:function.",
        choices=("dpm", "ddim", "ddpm"),
        own=True,
    )
    steps: int = option(None, "Denoising steps.", low=1, high=1000)
    eta: float = option(
        None, "Fresh noise in a step of DDIM: 0 none, 1 as much as DDPM.", low=0, high=1
    )
    guidance: float = option(
        None,
        "How much the music matters: 0 not at all, 1 as learned, 2 exaggerated (twice the time).",
        low=0,
        high=100,
    )
    autoguidance: float = option(
        None,
        "1 takes guesses as they are, more pushes them away from the mean of all dances.",
        low=1,
        high=10,
    )
    genre: str | dict | None = option(  # noqa: RUF009 - it is a field
        None,
        "What to dance: a genre or a mix such as hiphop=0.7,house=0.3; default: by the song's "
        "tempo; 'any': none in particular. Only models that know genres.",
        parse=mix_of,
    )
    energy: float | str | tuple | None = option(
        None,
        "How full the dance is: a number multiplies the song's own energy, points such as "
        "0:0.3,10:1 (seconds:value) replace it; 'any': none in particular. Only models that "
        "listen to energy.",
        parse=energy_of,
    )
    foot_contact: bool = option(
        None,
        "Limit speeds, keep bodies on the floor and standing feet in place; False: none of it.",
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
    def names(cls) -> list[str]:
        """Of all options."""
        return [one.name for one in fields(cls)]

    def resolve(self, model, song) -> Self:
        """A new request in which nothing is left open, checked against the model and the song.

        Raises: ValueError naming the option, its value and what is allowed; also for a silent song
        or one under a second.
        """
        seconds = _seconds(self.seconds, song)
        given: dict[str, Any] = vars(self)
        asked = {name: value for name, value in given.items() if value is not None}
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
        filled = replace(
            filled,
            genre=resolved_genre(self.genre, usual.get("genre", BY_TEMPO), model, song),
            energy=resolved_energy(self.energy, usual["energy"], model, filled.frames),
        )
        for name, high in self._limits(model.config).items():
            in_range(name, getattr(filled, name), 1, high)
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
            and not (one.name == "energy" and is_curve(value))
        }


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
