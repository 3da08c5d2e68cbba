"""What can be asked of models that make a dance bit by bit, each from what was danced before.

Read first: `dancediff.generation.dance_request`.
"""

from dataclasses import dataclass
from typing import ClassVar

from dancediff.generation.dance_request import DanceRequest
from dancediff.generation.option import option


@dataclass(frozen=True, kw_only=True)
class AutoregressiveRequest(DanceRequest):
    """What can be asked of all of them: a group is dancers who know nothing of each other.

    ``seed_motion``: a `Motion` whose end comes before the first frame; one dancer of it for all,
    or one for each.

    Raises: ValueError naming the option, its value and what is allowed.

    >>> AutoregressiveRequest(dancers=0)
    Traceback (most recent call last):
    ValueError: dancers=0 must be a number of at least 1
    """

    not_told: ClassVar[tuple[str, ...]] = ("device", "seed_motion")

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


AUTOREGRESSIVE: tuple[type[AutoregressiveRequest], ...] = (FACTRequest, BailandoRequest)
