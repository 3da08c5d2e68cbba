r"""What can be asked of models that take noise away step by step.

Read first: `dancediff.generation.dance_request`.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

from dancediff.extensions.registry import REGISTRY
from dancediff.generation.dance_request import DanceRequest
from dancediff.generation.energy_option import energy_of, is_curve, resolved_energy
from dancediff.generation.genre_mix import BY_TEMPO, mix_of, resolved_genre
from dancediff.generation.option import option
from dancediff.generation.presets import PAPER
from dancediff.genre import CAPTURED, TEMPOS


def genre_option() -> Any:
    """The option of models that know genres."""
    return option(
        None,
        "What to dance: a genre or a mix such as hiphop=0.7,house=0.3; default: by the song's "
        "tempo; 'any': none in particular, the default with a microphone, whose tempo "
        f"nobody knows yet. Only models that know genres: {', '.join(TEMPOS)}, and some of them "
        f"{' and '.join(CAPTURED)}.",
        parse=mix_of,
    )


def sigma_min_option(default: float | None) -> Any:
    """The option that says where DPM-Solver++ ends; None where presets have the default."""
    return option(
        default,
        "For dpm: noise, as a share of the signal, at which the last guess is taken; 0: as little "
        "as there is.",
        low=0,
        high=1,
    )


@dataclass(frozen=True, kw_only=True)
class DiffusionRequest(DanceRequest):
    """The options that all denoisers share.

    Raises: ValueError naming the option, its value and what is allowed.

    >>> DiffusionRequest(eta=2)
    Traceback (most recent call last):
    ValueError: eta=2 must lie in 0 ... 1
    """

    left_out: ClassVar[tuple[str, ...]] = ("device", "at_once", "start", "end", "constraints")

    sampler: str = option(
        None,
        "How noise is taken away: DPM-Solver++, DDIM, DDPM in all steps, or module:function.",
        choices=("dpm", "ddim", "ddpm"),
        own=True,
    )
    steps: int = option(None, "Denoising steps.", low=1, high=1000)
    eta: float = option(
        None, "Fresh noise in a step of DDIM or DPM-Solver++: 0 none, 1 as DDPM.", low=0, high=1
    )
    sigma_min: float = sigma_min_option(0.0)
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
    autoguidance_end: float = option(
        0.0,
        "Noise, as a share of the signal, below which guesses are not pushed; 0: to the end.",
        low=0,
        high=100,
    )
    genre: str | dict | None = genre_option()  # noqa: RUF009 - it is a field
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

    def resolve(self, model, song) -> Self:
        """As `DanceRequest.resolve`; genre and energy follow from the song."""
        filled, usual = super().resolve(model, song), self.usual(model)
        return replace(
            filled,
            genre=resolved_genre(self.genre, usual.get("genre", BY_TEMPO), model, song),
            energy=resolved_energy(self.energy, usual["energy"], model, filled.frames),
        )

    def usual(self, model) -> dict[str, Any]:
        """What the preset says, without what the model cannot do.

        Raises: ValueError when the latter was asked for.
        """
        asked, usual = self.asked(), super().usual(model)
        if not has_preconditioning(model):
            for name, off in needs_preconditioning(self.family).items():
                if asked.get(name, off) != off:
                    raise ValueError(
                        f"{name}={asked[name]!r} needs statistics of the training data that only "
                        f"a model with preconditioning has; use {off!r}"
                    )
                usual[name] = off
        return usual

    def _limits(self, config) -> dict[str, int]:
        return super()._limits(config) | {"steps": config.num_steps}

    def facts(self) -> dict:
        """As `DanceRequest.facts`, without a curve of energy."""
        facts = super().facts()
        if is_curve(facts.get("energy")):
            del facts["energy"]
        return facts


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
