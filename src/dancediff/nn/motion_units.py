r"""Choreographic units: eight frames of half a body become one code, and codes become motion again.

Read first: `dancediff.nn.quantizer` · Siyao et al. 2022 (Bailando), pose VQ-VAE.

Symbols (axes: b batch · f frames · u codes, one for eight frames · c channels)
    x       half of a body, normalised   (b, f, c)
    codes   its units                    (b, u)
"""

import torch
from torch import Tensor, nn

from dancediff.nn.attention import full_precision
from dancediff.nn.losses import mean
from dancediff.nn.quantizer import VectorQuantizer

STAGES = 3  # each halves the number of frames
FRAMES = 2**STAGES  # of a unit
DEPTH = 3  # residual blocks of a stage, which look 1, 3 and 9 tokens to each side
REACH = 26  # units to each side on which a decoded frame may depend
COMMITMENT = 0.02


class ResidualBlock(nn.Module):
    """Add what a convolution over three tokens finds, ``dilation`` apart; (b, c, u) -> the same.

    >>> ResidualBlock(8, dilation=3)(torch.randn(2, 8, 5)).shape
    torch.Size([2, 8, 5])
    """

    def __init__(self, channels: int, dilation: int):
        super().__init__()
        self.block = nn.Sequential(
            nn.ReLU(),
            nn.Conv1d(channels, channels, 3, padding=dilation, dilation=dilation),
            nn.ReLU(),
            nn.Conv1d(channels, channels, 1),
        )

    def forward(self, h: Tensor) -> Tensor:
        """See above."""
        return h + self.block(h)


def residual_blocks(width: int) -> list[nn.Module]:
    """Those of a stage."""
    return [ResidualBlock(width, 3**k) for k in range(DEPTH)]


class UnitEncoder(nn.Module):
    """From frames to vectors, one for eight; (b, f, c) -> (b, f / 8, code_dim).

    >>> UnitEncoder(54, width=16, code_dim=8)(torch.randn(2, 24, 54)).shape
    torch.Size([2, 3, 8])
    """

    def __init__(self, channels: int, *, width: int, code_dim: int):
        super().__init__()
        layers: list[nn.Module] = []
        for k in range(STAGES):
            layers.append(nn.Conv1d(width if k else channels, width, 4, stride=2, padding=1))
            layers += residual_blocks(width)
        self.layers = nn.Sequential(*layers, nn.Conv1d(width, code_dim, 3, padding=1))

    def forward(self, x: Tensor) -> Tensor:
        """Convolutions along time."""
        return self.layers(x.mT).mT


class UnitDecoder(nn.Module):
    """The way back; (b, u, code_dim) -> (b, 8 u, c).

    >>> UnitDecoder(54, width=16, code_dim=8)(torch.randn(2, 3, 8)).shape
    torch.Size([2, 24, 54])
    """

    def __init__(self, channels: int, *, width: int, code_dim: int):
        super().__init__()
        layers: list[nn.Module] = [nn.Conv1d(code_dim, width, 3, padding=1)]
        for _ in range(STAGES):
            layers += residual_blocks(width)
            layers.append(nn.ConvTranspose1d(width, width, 4, stride=2, padding=1))
        self.layers = nn.Sequential(*layers, nn.Conv1d(width, channels, 3, padding=1))

    def forward(self, z: Tensor) -> Tensor:
        """Convolutions along time."""
        return self.layers(z.mT).mT


class Units(nn.Module):
    """The units of half a body: a VQ-VAE.

    Source: Bailando, pose VQ-VAE; layers and sizes of the released code.

    Shapes: x (b, f, c) -> x_hat (b, f, c), z_q (b, f / 8, code_dim), commitment scalar.

    >>> units = Units(54, width=16, code_dim=8, num_codes=4)
    >>> x_hat, z_q, _ = units(torch.randn(2, 24, 54), torch.Generator())
    >>> x_hat.shape, units.codes(torch.randn(2, 24, 54)).shape
    (torch.Size([2, 24, 54]), torch.Size([2, 3]))
    """

    def __init__(
        self, channels: int, *, width: int, code_dim: int, num_codes: int, decay: float = 0.99
    ):
        """``decay``: see `dancediff.nn.quantizer.VectorQuantizer`."""
        super().__init__()
        self.encoder = UnitEncoder(channels, width=width, code_dim=code_dim)
        self.quantizer = VectorQuantizer(num_codes, code_dim, decay=decay)
        self.decoder = UnitDecoder(channels, width=width, code_dim=code_dim)

    def forward(self, x: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """There and back; in training the codebook learns."""
        z_q, _, commitment = self.quantizer(self.encoder(x), generator)
        return full_precision(self.decoder(z_q)), z_q, commitment

    def codes(self, x: Tensor) -> Tensor:
        """The units of a motion, (b, f, c) -> (b, f / 8)."""
        return self.quantizer.codes(self.encoder(x))

    def motion(self, codes: Tensor) -> Tensor:
        """The motion of units, (b, u) -> (b, 8 u, c)."""
        return full_precision(self.decoder(self.quantizer.e[codes]))


def l_motion(x_hat: Tensor, x: Tensor) -> Tensor:
    r"""Values, velocities and accelerations: $\lVert x - \hat x \rVert_1 +
    \lVert x' - \hat x' \rVert_1 + \lVert x'' - \hat x'' \rVert_1$.

    Source: Bailando, pose VQ-VAE.  Differs: means.  Shapes: (b, f, c) -> scalar.

    >>> l_motion(torch.ones(1, 9, 2), torch.zeros(1, 9, 2)).item()  # an offset moves as it should
    1.0
    """
    error = x_hat - x
    return sum((mean(error.diff(n=n, dim=-2).abs()) for n in (1, 2)), mean(error.abs()))
