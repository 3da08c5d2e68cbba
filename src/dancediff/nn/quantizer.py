r"""Vector quantisation: every vector becomes the nearest entry of a learned codebook.

Read first: van den Oord et al. 2017 (VQ-VAE) section 3 · Dhariwal et al. 2020 (Jukebox).

Symbols (axes: any axes in front · k codes · c channels)
    z        vectors of an encoder                               (..., c)
    e        the codebook                                        (k, c)
    N, S     running number and sum of the vectors of each code  (k,), (k, c)
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from dancediff.nn.attention import full_precision


class VectorQuantizer(nn.Module):
    r"""The nearest code of each vector, and a codebook that follows the vectors by averages.

    $$i = \arg\min_i \lVert z - e_i \rVert^2, \qquad z_q = z + \text{stop}(e_i - z)$$
    $$N_i \leftarrow m N_i + (1-m)\, n_i, \quad S_i \leftarrow m S_i + (1-m) \sum_{z \to i} z,
      \quad e_i = S_i / N_i$$

    Gradients pass z_q as if it were z. The codebook begins with vectors of the first batch; a code
    that is used less than ``restart`` times the mean begins anew with a vector of the batch.

    Source: VQ-VAE eq. 1 and appendix A.1; restarts: Jukebox.  Differs: N and S are
    buffers, so that a training that goes on keeps its codebook; restarts compare with the mean, not
    with 1 a batch, so that the batch size does not matter.

    Shapes: z (..., c) -> z_q (..., c), codes (...), commitment scalar.

    >>> quantizer = VectorQuantizer(8, 4)
    >>> z_q, codes, commitment = quantizer(torch.randn(2, 5, 4), torch.Generator())
    >>> z_q.shape, codes.shape, commitment.shape
    (torch.Size([2, 5, 4]), torch.Size([2, 5]), torch.Size([]))
    """

    e: Tensor
    N: Tensor
    S: Tensor

    def __init__(
        self, num_codes: int, channels: int, *, decay: float = 0.99, restart: float = 0.05
    ):
        """An empty codebook: it is filled by the first batch in training."""
        super().__init__()
        self.decay, self.restart = decay, restart
        self.register_buffer("e", torch.zeros(num_codes, channels))
        self.register_buffer("N", torch.zeros(num_codes))
        self.register_buffer("S", torch.zeros(num_codes, channels))

    def codes(self, z: Tensor) -> Tensor:
        """The number of the nearest code of each vector, (..., c) -> (...)."""
        flat = full_precision(z.detach()).flatten(0, -2)
        with torch.autocast(z.device.type, enabled=False):  # nearest needs all digits
            distances = self.e.square().sum(-1) - 2 * flat @ self.e.T  # and z^2, the same for all
        return distances.argmin(-1).reshape(z.shape[:-1])

    def forward(self, z: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
        r"""Quantised vectors, codes, and the commitment $\lVert z - \text{stop}(e_i) \rVert^2$.

        In training the codebook learns; ``generator`` (of the CPU) draws what it restarts with.
        """
        z = full_precision(z)
        if self.training:
            self._start(z, generator)
        codes = self.codes(z)
        z_e = self.e[codes]  # a copy: the codebook may change now
        if self.training:
            self._learn(z, codes, generator)
        return z + (z_e - z).detach(), codes, F.mse_loss(z, z_e)

    @torch.no_grad()
    def _start(self, z: Tensor, generator: torch.Generator) -> None:
        """Fill an empty codebook."""
        if not self.N.any():
            each = z[..., 0].numel() / len(self.e)
            self._set(torch.ones_like(self.N, dtype=torch.bool), z, each, generator)

    @torch.no_grad()
    def _learn(self, z: Tensor, codes: Tensor, generator: torch.Generator) -> None:
        """See the equations."""
        chosen = F.one_hot(codes.flatten(), len(self.e)).to(z)
        self.N.lerp_(chosen.sum(0), 1 - self.decay)
        with torch.autocast(z.device.type, enabled=False):
            self.S.lerp_(chosen.T @ z.flatten(0, -2), 1 - self.decay)
        self.e.copy_(self.S / self.N[:, None].clamp_min(1e-6))
        mean = self.N.mean()
        self._set(self.N < self.restart * mean, z, mean.item(), generator)

    def _set(self, which: Tensor, z: Tensor, count: float, generator: torch.Generator) -> None:
        """Give some codes vectors of the batch."""
        flat = z.flatten(0, -2)
        drawn = torch.randint(len(flat), (len(self.e),), generator=generator).to(z.device)
        self.e[which] = flat[drawn][which]
        self.N[which] = count
        self.S[which] = count * self.e[which]


def perplexity(codes: Tensor, num_codes: int) -> float:
    r"""How many codes, all used alike, would be as hard to guess: $e^{-\sum_i p_i \log p_i}$.

    >>> round(perplexity(torch.tensor([0, 1, 0, 1]), 8), 3)
    2.0
    """
    p = torch.bincount(codes.flatten(), minlength=num_codes).double() / codes.numel()
    return torch.special.entr(p).sum().exp().item()
