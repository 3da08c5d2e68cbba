r"""How the dancers of a group vary together.

Read first: `dancediff.extensions.preconditioning` · `dancediff.extensions.formation_prior`.

Symbols (axes: b batch · n dancers · r modes, as many · f frames · k frequencies
         c the two coordinates on the floor)
    c_n, mean   of each dancer            (b, n, k, c), (b, n, f, c)
    U, basis    orthonormal               (b, k, c, n, r)
    std         of each mode              (b, r, k, c)
"""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass
class GroupModes:
    r"""How dancers vary together: another basis for some features, one for each frequency.

    $$\tilde c_{r} = \sum_n U_{nr}\, c_n$$

    ``features`` are the motion features that have modes.
    """

    features: slice
    mean: Tensor
    basis: Tensor
    std: Tensor

    def turn(self, coefficients: Tensor) -> Tensor:
        """From dancers to modes, (b, n, k, d)."""
        return self._changed(coefficients, "bkcnr,bnkc->brkc")

    def turn_back(self, coefficients: Tensor) -> Tensor:
        """From modes to dancers, (b, n, k, d)."""
        return self._changed(coefficients, "bkcnr,brkc->bnkc")

    def _changed(self, coefficients: Tensor, how: str) -> Tensor:
        changed = coefficients.clone()
        changed[..., self.features] = torch.einsum(
            how, self.basis.to(coefficients), coefficients[..., self.features]
        )
        return changed

    def placed(self, mean: Tensor) -> Tensor:
        """A mean (d,) for all, with what is expected of each: (b, n, f, d)."""
        placed = mean.expand(*self.mean.shape[:3], -1).clone()
        placed[..., self.features] += self.mean
        return placed

    def std_with_modes(self, std: Tensor) -> Tensor:
        """Those of all features (k, d), with those of the modes: (b, n, k, d)."""
        b, n = self.mean.shape[:2]
        changed = std.expand(b, n, -1, -1).clone()
        changed[..., self.features] = self.std
        return changed
