r"""Multi-genre discriminator: is this a real dance of this genre to this music?

Read first: notebook 12 · Lodge section 3.4, eq. 9 · Kim et al. 2022 (MNET).

Symbols (axes: b batch · f frames · g genres · d motion, m music features
         l tokens · c channels of a head)
    x        motion, true or made, normalised             (b, f, d)
    M        music features, standardised                 (b, f, m)
    genre    number of the genre                          (b,)
    logit    above 0: real                                (b,)
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from dancediff.genre import FINEDANCE
from dancediff.nn.attention import FeedForward, full_precision
from dancediff.nn.encoder_layer import SelfAttention
from dancediff.nn.mapping_network import MappingNetwork


@dataclass(frozen=True)
class DiscriminatorConfig:
    """Sizes; plain values, so that it can be stored as JSON.

    >>> DiscriminatorConfig().num_layers
    4
    """

    d_model: int = 512  # width of a token
    num_heads: int = 8  # of attention
    num_layers: int = 4  # of the encoder
    ff_dim: int = 1024  # width inside a feed-forward block
    head_hidden: int = 512  # width between a dance and the verdicts; 1 in the released code
    num_frames: int = 256  # of one local segment
    motion_dim: int = 139  # features of a frame of motion
    music_dim: int = 35  # features of a frame of music
    genres: tuple[str, ...] = FINEDANCE  # that it tells apart
    dropout: float = 0.0  # share of values that are set to zero in training

    def __post_init__(self):
        """JSON knows no tuples.

        Raises: ValueError for a width that the heads cannot share.
        """
        if self.d_model % self.num_heads:
            raise ValueError(
                f"d_model={self.d_model} must be a multiple of num_heads={self.num_heads}"
            )
        object.__setattr__(self, "genres", tuple(self.genres))


class PlacedAttention(SelfAttention):
    r"""Self-attention with one learned logit for every pair of places.

    $$\text{softmax}\Big(\frac{Q K^\top}{\sqrt c} + B\Big) V$$

    B is all that this network knows about time, and about which motion belongs to which music.

    Source: Lodge's code (B is shared by the heads; Q, K, V have no bias).
    Shapes: x (b, l, d_model) with l = 2 f, music first -> the same.

    >>> PlacedAttention(16, num_heads=2, num_frames=3)(torch.randn(3, 6, 16)).shape
    torch.Size([3, 6, 16])
    """

    def __init__(self, d_model: int, num_heads: int, num_frames: int):
        """Learned: what `SelfAttention` has, and B."""
        super().__init__(d_model, num_heads, qkv_bias=False)
        self.places = nn.Parameter(torch.zeros(2 * num_frames, 2 * num_frames))

    def forward(self, x: Tensor) -> Tensor:  # type: ignore[override] # B is the mask
        """Every token gathers what it needs from all others."""
        return super().forward(x, self.places)


class GenreDiscriminator(nn.Module):
    r"""Motion and music side by side through a small transformer; one verdict for each genre.

    $$D_g(x, M) = \text{map}_g\Big(\tfrac{1}{2f} \sum_l \text{encoder}([W_M M,\; W_x x])_l\Big)$$

    Source: Lodge section 3.4, after MNET; the layers are those of its code.  Differs: the released
    mapping is one number wide, so that the verdicts of all genres are functions of one number;
    ``head_hidden`` widens it. With 1 there are the published 9,544,259 weights.

    Shapes: x (b, f, d), M (b, f, m), genre (b,) -> logit (b,).
    Raises: ValueError for another number of frames, of which B knows the places.

    >>> D = GenreDiscriminator(DiscriminatorConfig(d_model=16, ff_dim=32, num_frames=20))
    >>> D(torch.randn(2, 20, 139), torch.randn(2, 20, 35), torch.tensor([0, 10])).shape
    torch.Size([2])
    """

    def __init__(self, config: DiscriminatorConfig | None = None):
        """Pre-norm layers of attention and feed-forward."""
        super().__init__()
        self.config = c = config or DiscriminatorConfig()
        self.embed_music = nn.Linear(c.music_dim, c.d_model)
        self.embed_motion = nn.Linear(c.motion_dim, c.d_model)
        self.attentions = nn.ModuleList(
            PlacedAttention(c.d_model, c.num_heads, c.num_frames) for _ in range(c.num_layers)
        )
        self.feed_forwards = nn.ModuleList(
            FeedForward(c.d_model, c.ff_dim, c.dropout) for _ in range(c.num_layers)
        )
        self.norms = nn.ModuleList(nn.LayerNorm(c.d_model) for _ in range(2 * c.num_layers))
        self.verdicts = MappingNetwork(c.d_model, 1, len(c.genres), hidden=c.head_hidden)

    def logits(self, x: Tensor, M: Tensor) -> Tensor:
        """The verdict as each genre (b, g)."""
        f = self.config.num_frames
        for name, value in (("x", x), ("M", M)):
            if value.shape[1] != f:
                raise ValueError(f"{name} has {value.shape[1]} frames; the discriminator knows {f}")
        h = full_precision(torch.cat([self.embed_music(M), self.embed_motion(x)], dim=1))
        for i, (attend, feed_forward) in enumerate(
            zip(self.attentions, self.feed_forwards, strict=True)
        ):
            h = h + attend(self.norms[2 * i](h))
            h = h + feed_forward(self.norms[2 * i + 1](h))
        return self.verdicts(h.mean(dim=1))[..., 0]

    def forward(self, x: Tensor, M: Tensor, genre: Tensor) -> Tensor:
        """The verdict as the genre asked about."""
        return self.logits(x, M).gather(1, genre[:, None])[:, 0]
