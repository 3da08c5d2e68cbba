r"""Consistency critic: how well do the dancers of a group go together, and with what w asks for?

Read first: Le et al. 2023 (GCD) section 3.4 · `dancediff.papers.gcd.contrast`.

Symbols (axes: b batch · n dancers · f frames · d motion features · c channels)
    x_t   a noisy group, normalised          (b, n, f, d)
    w     group embedding                    (b, c)
    f     the score                          (b,)
"""

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.nn.attention import Attention, FeedForward
from dancediff.nn.conditioning import BatchInvariantLinear, sinusoid
from dancediff.papers.gcd.group_attention import GroupGlobalAttention
from dancediff.papers.gcd.group_modulation import GroupModulation


class CriticBlock(nn.Module):
    """A block of GCD's decoder without music: each dancer alone, then the group, then w.

    Shapes: h (b, n, f, c), w (b, c) -> like h.

    >>> block = CriticBlock(16, 5, num_heads=2, ff_dim=32)
    >>> block(torch.randn(2, 3, 7, 16), torch.randn(2, 16)).shape
    torch.Size([2, 3, 7, 16])
    """

    def __init__(self, d_model: int, max_dancers: int, **sizes):
        """``sizes``: those of `GroupGlobalAttention`."""
        super().__init__()
        dropout = sizes.get("dropout", 0.0)
        self.attention = Attention(d_model, sizes["num_heads"])
        self.feed_forward = FeedForward(d_model, sizes["ff_dim"], dropout)
        self.norms = nn.ModuleList(nn.LayerNorm(d_model) for _ in range(2))
        self.group = GroupGlobalAttention(d_model, max_dancers, **sizes)
        self.modulation = GroupModulation(d_model)
        self.dropout = nn.Dropout(dropout)

    def forward(self, h: Tensor, w: Tensor) -> Tensor:
        """The three steps in turn."""
        alone = rearrange(h, "b n f c -> (b n) f c")
        frames = torch.arange(h.shape[2], device=h.device)
        x = self.norms[0](alone)
        alone = alone + self.dropout(self.attention(x, x, frames, frames))
        alone = alone + self.dropout(self.feed_forward(self.norms[1](alone)))
        h = rearrange(alone, "(b n) f c -> b n f c", b=len(h))
        return self.modulation(self.group(h), w)


class ConsistencyCritic(nn.Module):
    r"""One number for a noisy group: the mean of what all its tokens say.

    $$f(x_t, w, t) = \tfrac{1}{nf} \sum_{i,j} \text{MLP}(h_{i,j})$$

    What tokens say must not be linear in h: the modulation has just set the mean of every channel,
    so that the mean of a linear map would be the same for all groups.

    Trained by InfoNCE it is, but for a constant, the log of how much likelier a group is than one
    of dancers thrown together.

    Source: GCD section 3.4.  Differs: the paper does not say how it pools nor how it is told t; the
    public code reads the first token.

    Shapes: x_t (b, n, f, d), w (b, c), t (b,) -> (b,).

    >>> critic = ConsistencyCritic(16, 5, motion_dim=151, num_layers=1, num_heads=2, ff_dim=32)
    >>> critic(torch.randn(2, 3, 7, 151), torch.randn(2, 16), torch.tensor([10, 900])).shape
    torch.Size([2])
    """

    def __init__(
        self, d_model: int, max_dancers: int, *, motion_dim: int, num_layers: int, **sizes
    ):
        """``sizes``: those of `GroupGlobalAttention`."""
        super().__init__()
        self.embed = nn.Linear(motion_dim, d_model)
        self.d_model = d_model
        self.step = nn.Sequential(
            BatchInvariantLinear(d_model, 4 * d_model),
            nn.Mish(),
            BatchInvariantLinear(4 * d_model, d_model),
        )
        self.blocks = nn.ModuleList(
            CriticBlock(d_model, max_dancers, **sizes) for _ in range(num_layers)
        )
        self.out = nn.Sequential(
            nn.Linear(d_model, d_model // 4), nn.GELU(), nn.Linear(d_model // 4, 1)
        )

    def forward(self, x_t: Tensor, w: Tensor, t: Tensor) -> Tensor:
        """See the equation."""
        step = self.step(sinusoid(t, self.d_model))
        h = (self.embed(x_t) + step[:, None, None]).float()
        for block in self.blocks:
            h = block(h, w)
        return self.out(h).float().mean(dim=(1, 2, 3))
