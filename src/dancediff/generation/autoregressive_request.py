"""What can be asked of models that make a dance bit by bit, each from what was danced before.

Read first: `dancediff.generation.dance_request`.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from dancediff.generation.dance_request import DanceRequest
from dancediff.generation.diffusion_request import genre_option
from dancediff.generation.genre_mix import BY_TEMPO, mix_weights, resolved_genre
from dancediff.generation.option import option


@dataclass(frozen=True, kw_only=True)
class AutoregressiveRequest(DanceRequest):
    """What can be asked of all of them: dancers know each other in CoDancers alone.

    ``seed_motion``: a `Motion` whose end comes before the first frame; one dancer of it for all,
    or one for each.

    Raises: ValueError naming the option, its value and what is allowed.

    >>> AutoregressiveRequest(dancers=0)
    Traceback (most recent call last):
    ValueError: dancers=0 must be a number of at least 1
    """

    left_out: ClassVar[tuple[str, ...]] = ("device", "seed_motion")

    dancers: int = option(3, "How many people dance.", low=1)
    seed_motion: object = option(None, "A dance that goes on; default: people who stand.")
    seed_noise: float = option(
        None, "Random change of the poses before the first frame, in half ranges of the data."
    )

    def _limits(self, config) -> dict[str, int]:
        return super()._limits(config) | {"dancers": config.max_dancers}


@dataclass(frozen=True, kw_only=True)
class UnitRequest(AutoregressiveRequest):
    """What can be asked of models that draw a dance from a vocabulary of units."""

    temperature: float = option(
        1.0, "Below 1 likely units are drawn more often, above 1 unlikely ones.", low=0.01, high=100
    )
    top_k: int = option(None, "From how many of the most likely units is drawn.", low=1)


@dataclass(frozen=True, kw_only=True)
class BailandoRequest(UnitRequest):
    """What can be asked of Bailando."""

    family: ClassVar[str] = "bailando"


@dataclass(frozen=True, kw_only=True)
class FACTRequest(AutoregressiveRequest):
    """What can be asked of FACT: nothing is random but the poses before the first frame."""

    family: ClassVar[str] = "fact"

    keep: int = option(None, "Frames that are kept of each guess.", low=1)

    def _limits(self, config) -> dict[str, int]:
        return super()._limits(config) | {"keep": config.targets}


@dataclass(frozen=True, kw_only=True)
class MNETRequest(AutoregressiveRequest):
    """What can be asked of MNET."""

    family: ClassVar[str] = "mnet"

    genre: str | dict | None = genre_option()  # noqa: RUF009 - it is a field

    def resolve(self, model, song) -> Self:
        """As `DanceRequest.resolve`; the genre follows from the song."""
        filled = super().resolve(model, song)
        return replace(filled, genre=resolved_genre(self.genre, BY_TEMPO, model, song))

    def genre_shares(self, genres: tuple[str, ...]) -> list[float]:
        """The share of each genre, of a resolved request."""
        assert self.genre is not None
        return mix_weights(self.genre, genres)[0].tolist()


@dataclass(frozen=True, kw_only=True)
class CoDancersRequest(UnitRequest):
    """What can be asked of CoDancers, whose dancers see those to their left, or all."""

    family: ClassVar[str] = "codancers"

    reweight: float = option(
        50.0, "Units that training met often count less: most at small values; 0: not at all."
    )


AUTOREGRESSIVE: tuple[type[AutoregressiveRequest], ...] = (
    FACTRequest,
    BailandoRequest,
    MNETRequest,
    CoDancersRequest,
)
