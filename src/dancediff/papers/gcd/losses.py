r"""The losses of GCD: reconstruction, geometry, and contrast.

Read first: Le et al. 2023 (GCD) section 3.5 · `dancediff.nn.motion_losses`.
"""

from dataclasses import asdict, dataclass

from torch import Tensor

from dancediff.nn.losses import Comparison
from dancediff.nn.motion_losses import l_contact, l_fk, l_simple, l_vel


@dataclass(frozen=True)
class GCDWeights:
    """Weight of each term.

    Source: GCD section 4.1; the public code has contact 5.0 and contrast 1e-5.

    >>> GCDWeights().terms()["contrast"]
    0.001
    """

    simple: float = 1.0  # reconstruction
    vel: float = 1.0  # change from frame to frame
    fk: float = 1.0  # where joints are
    contact: float = 0.005  # feet that stand still
    contrast: float = 0.001  # groups against dancers thrown together

    def terms(self) -> dict[str, float]:
        """The weights by the name of their term."""
        return asdict(self)


def geometric_losses(c: Comparison) -> dict[str, Tensor]:
    """All terms but the contrast, unweighted and by name."""
    return {
        "simple": l_simple(c.x_raw, c.x_0),
        "vel": l_vel(c.x_hat, c.x_0),
        "fk": l_fk(c.joints, c.joints_0),
        "contact": l_contact(c.joints, c.contact),
    }
