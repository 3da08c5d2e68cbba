r"""How the dancers of a group vary together.

Read first: `dancediff.extensions.preconditioning`.

Symbols (axes: b batch · n dancers · r modes, as many · k frequencies · d motion features)
    c_n      of each dancer   (b, n, k, d)
    U        orthonormal      (n, r)
    sigma    of each mode     (r, k, d)
"""

from abc import ABC, abstractmethod
from typing import ClassVar

from torch import Tensor


class GroupModes(ABC):
    r"""Another basis for the dancers of a group, in which each mode varies for itself.

    $$\tilde c_r = \sum_n U_{nr}\, c_n, \qquad \tilde c_r \sim \mathcal N(0, \sigma_r^2)$$

    U may differ from frequency to frequency and feature to feature; features that a kind of modes
    does not speak of stay as they are. ``THERE`` and ``BACK`` are its products with U, as einsum
    has them.
    """

    THERE: ClassVar[str]
    BACK: ClassVar[str]

    def turn(self, coefficients: Tensor) -> Tensor:
        """From dancers to modes, (b, n, k, d)."""
        return self.changed(coefficients, self.THERE)

    def turn_back(self, coefficients: Tensor) -> Tensor:
        """From modes to dancers, (b, n, k, d)."""
        return self.changed(coefficients, self.BACK)

    def placed(self, mean: Tensor) -> Tensor:
        """A mean that broadcasts to (b, n, f, d), with what is expected of each dancer."""
        return mean

    @abstractmethod
    def changed(self, coefficients: Tensor, how: str) -> Tensor:
        """The product with U, of the features that have modes, (b, n, k, d)."""

    @abstractmethod
    def std_with_modes(self, std: Tensor) -> Tensor:
        """Standard deviations of dancers' features, with those of the modes: (b, n, k, d)."""
