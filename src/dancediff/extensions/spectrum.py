"""What is known of motion before a network: its mean, and how far each frequency varies.

Symbols (axes: b batch · k frequencies · d motion features)
"""

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Spectrum:
    """Of each row of a batch: mean (b, d), and standard deviation of each frequency (b, k, d)."""

    mean: Tensor
    std: Tensor
