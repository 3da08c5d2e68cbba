"""What can be asked of models that dance in segments of 5 s.

Read first: `dancediff.generation.request`.
"""

from dataclasses import dataclass
from typing import ClassVar

from dancediff.generation.diffusion_request import DiffusionRequest
from dancediff.generation.option import option


@dataclass(frozen=True, kw_only=True)
class SegmentedRequest(DiffusionRequest):
    """What can be asked of models that dance in segments of 5 s."""

    dancers: int = option(3, "How many people dance.", low=1)
    overlap: int = option(75, "Frames that segments of 5 s share.", low=1)
    frequency_clip: bool = option(
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
class GCDRequest(SegmentedRequest):
    """What can be asked of GCD.

    >>> GCDRequest(gamma=-1).gamma
    -1.0
    """

    family: ClassVar[str] = "gcd"

    gamma: float = option(
        0.0, "Above 0 dancers are more in step, below more varied.", low=-100, high=100
    )


@dataclass(frozen=True, kw_only=True)
class TCDiffRequest(SegmentedRequest):
    """What can be asked of TCDiff, whose navigator decides where everybody goes."""

    family: ClassVar[str] = "tcdiff"
