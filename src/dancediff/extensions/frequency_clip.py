r"""Frequency clip: guesses stay within what the training set has, one frequency at a time.

Read first: notebook 06 · `dancediff.extensions.preconditioning`.

With no cut at all, music unlike any in training sent dancers across the stage at 6 m/s.

Symbols (axes: f frames · k frequencies · d motion features)
    mean, std   of each feature, and of each frequency over the training set   (d,), (k, d)
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from dancediff.extensions.preconditioning import dct_matrix
from dancediff.lookup import table

LIMIT = 4.0  # standard deviations that a guess may lie from the mean; real dances rarely do


@dataclass(frozen=True)
class FrequencyClip:
    r"""A ``clamp`` of `dancediff.diffusion.samplers.sample`.

    $$\mu + C^\top \operatorname{clip}(C (x - \mu),\ -4\,\sigma,\ 4\,\sigma)$$

    C is a discrete cosine transform over the frames.

    Source: ours, in place of the published cut at +-1.  Differs: that leaves fast trembling alone
    and cuts places on the floor, which may lie far out in a long dance.

    >>> clip = FrequencyClip(torch.zeros(1), torch.full((8, 1), 0.5))
    >>> round(clip(torch.full((8, 1), 9.0)).max().item(), 4)
    0.7071
    """

    mean: Tensor
    std: Tensor

    def __call__(self, x: Tensor) -> Tensor:
        """Clip a guess (..., f, d), normalised; shorter windows have fewer frequencies."""
        rows = (torch.arange(x.shape[-2], device=x.device) * len(self.std)) // x.shape[-2]
        C, bound = table(dct_matrix, x.shape[-2], like=x), LIMIT * self.std[rows]
        coefficients = C @ (x - self.mean)
        return self.mean + C.T @ torch.minimum(torch.maximum(coefficients, -bound), bound)
